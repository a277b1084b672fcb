"""The electronics of a foot: what is sent for an element, and what the answers mean."""
