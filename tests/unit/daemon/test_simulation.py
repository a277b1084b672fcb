"""What a simulated robot cannot be: each a line that names the key or the file."""
