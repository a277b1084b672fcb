"""How wrong an estimator is, beside the Cramer-Rao bound."""
