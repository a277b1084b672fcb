"""Study pages that laboratory commands write, beside those of `footsense.lab.studies`."""
