"""Electronics boards of a leg: I2C transactions of each element's conversion, and decoding of the answers."""
