"""The studies: each answers a question raised or left open by the paper, with a table and a figure."""
