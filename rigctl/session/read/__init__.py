"""Readers of sessions, also while they are written or after their writer was killed."""
