"""Commands `footsense lab ...`: models, studies and report."""
