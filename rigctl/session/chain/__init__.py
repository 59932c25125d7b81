"""Checks that the rows of a part are those that were recorded, by its chain of digests."""
