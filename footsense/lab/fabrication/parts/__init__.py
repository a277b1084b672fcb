"""Part files: flex artwork (Gerber), sheets (DXF) and solids (STEP)."""
