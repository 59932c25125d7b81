"""Sessions to spike counts, force matrices and features."""
