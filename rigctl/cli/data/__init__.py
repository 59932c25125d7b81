"""Commands that make, import, check or describe data."""
