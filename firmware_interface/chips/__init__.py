"""Registers of the chips, as their data sheets number them."""
