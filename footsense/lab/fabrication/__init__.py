"""Fabrication files of a foot: solids, flex artwork, sheets, drawing, documents, each read back and checked."""
