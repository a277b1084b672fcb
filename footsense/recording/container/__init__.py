"""A recording as an MCAP container: its messages, its writer, and its checked reader."""
