"""Study `tradeoff`: age of a force against force error, over the daemon's whole processing chain."""
