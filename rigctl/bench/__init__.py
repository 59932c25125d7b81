"""Simulated bench: mechanics, skin, load cell, textures, with the real firmware before it."""
