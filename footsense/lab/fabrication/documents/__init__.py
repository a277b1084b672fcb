"""Fabrication documents: drawing, picture of the parts, bill of materials, assembly steps, checklist."""
