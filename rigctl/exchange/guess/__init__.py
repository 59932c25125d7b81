"""A map for unknown recordings, guessed from their names, columns and values."""
