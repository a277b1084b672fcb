"""Simulated test stand: a stick that presses the foot, and the force sensor under the foot."""
