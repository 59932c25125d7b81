"""Checks that a session is whole."""
