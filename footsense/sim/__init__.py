"""The simulator: feet, chips at byte level, buses in bit time, and scenes. Nothing of it knows a driver."""
