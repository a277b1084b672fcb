"""What touches the operating system's buses; one vendor library a file."""
