"""Mutated files of every kind and mutated requests: refused in a sentence, or read as they are."""
