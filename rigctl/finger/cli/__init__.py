"""Commands of the moving finger."""
