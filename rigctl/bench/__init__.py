"""The simulated bench: mechanics, skin, load cell, textures, noise, ground truth."""
