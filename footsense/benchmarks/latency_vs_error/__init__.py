"""Study `tradeoff`: age of a force against its error, over the whole chain of the daemon."""
