"""The studies: each answers one question of the paper, or one that it leaves, with a table and a figure."""
