"""Commands with which somebody sets up a robot: its computer and its file, its buses and feet looked at."""
