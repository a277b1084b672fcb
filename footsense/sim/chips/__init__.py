"""Chips and boards at byte level, from their data sheets."""
