"""Pages of the report that the commands of the laboratory write: their text and pictures."""
