"""Monte Carlo over fabricated feet, on one machine or a cluster."""
