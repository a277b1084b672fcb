"""What the ground does to each foot over time."""
