"""The commands of the moving finger."""
