"""Commands `footsense lab ...`: build and compare models, run studies, make the report."""
