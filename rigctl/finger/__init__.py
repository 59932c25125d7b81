"""The moving finger: a texture recognised while a person explores it."""
