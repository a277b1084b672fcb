"""The snapshot network: one scan of nine closures to a force, symmetric; for training on the 362 cases alone."""
