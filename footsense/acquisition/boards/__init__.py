"""Electronics boards of a foot: transactions of each element, and decoding of the answers."""
