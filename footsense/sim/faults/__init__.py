"""What breaks in a scene, and how each part fails."""
