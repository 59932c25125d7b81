"""Panels that drive the rig, and the state, prompts and events that belong to it."""
