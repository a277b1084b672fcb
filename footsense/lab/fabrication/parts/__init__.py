"""Parts of a foot as files: artwork of the flexes, sheets, solids; and the reading of these files."""
