"""Snapshot network: one scan of closures to a force, symmetric, for training on the 362 cases alone."""
