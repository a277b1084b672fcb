"""For a gait controller: contact of each leg, its events, the ground below it, and slips."""
