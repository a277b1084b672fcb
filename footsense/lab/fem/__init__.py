"""The elastic foot: a quarter of it meshed, solved in its symmetry classes, and read by adjoint fields."""
