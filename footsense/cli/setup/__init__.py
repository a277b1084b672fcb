"""Commands with which somebody sets up a robot: write its file, check it, and look at its buses and feet."""
