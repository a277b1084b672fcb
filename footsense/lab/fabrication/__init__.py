"""Fabrication files of a foot: solids, flex artwork, sheets, and the documents beside them."""
