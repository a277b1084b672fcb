"""What a builder knows: what the foot has to do (`wishes`), and with which materials, boards and processes."""
