"""Time alignment of elements that are converted one after the other."""
