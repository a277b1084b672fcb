"""Studies of the network: size, training, and the paper's procedure."""
