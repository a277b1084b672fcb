"""Register maps of the chips, after their data sheets."""
