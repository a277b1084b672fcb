"""Simulated chips and boards at register and byte level, from their data sheets."""
