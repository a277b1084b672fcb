"""Documents for people: drawing, picture, bill of materials, steps, checklist."""
