"""What the window remembers for its user between two starts."""
