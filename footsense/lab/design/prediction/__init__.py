"""A foot's response without a mesh of its own: closures of a few solved `shapes`, scaled and interpolated."""
