"""Sets of trials, the cache of what was encoded, and files in between."""
