"""The cavities between a foot's electrodes: the air in them."""
