"""What is on the buses of a robot that is set up: feet on adapters of which nothing is known, and their faults."""
