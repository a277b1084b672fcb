"""Monte Carlo simulations over fabricated feet, on one machine or a cluster."""
