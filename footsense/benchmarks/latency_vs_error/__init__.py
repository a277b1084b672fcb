"""Study `tradeoff`: age of the published forces against force error, over the daemon's whole processing chain."""
