"""A simulated test stand: presses of a stick and the force sensor under the foot."""
