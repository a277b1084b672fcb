"""Networks of several sizes on the boards of a foot: what a faster board, or a larger network, is worth."""
