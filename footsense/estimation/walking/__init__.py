"""What a gait controller is told: contact of each leg, its events, the ground below it, and slips."""
