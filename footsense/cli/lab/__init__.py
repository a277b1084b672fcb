"""Commands `footsense lab ...`: build models, run studies, make the report."""
