"""Render pictures of every page, and a film of a session, from live virtual rigs."""
