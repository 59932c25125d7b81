"""The kinds of files that are mutated."""
