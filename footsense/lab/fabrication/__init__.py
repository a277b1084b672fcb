"""From the numbers of a foot to files that a workshop can make it from, each read back and checked."""
