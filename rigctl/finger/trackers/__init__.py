"""Trackers: where the finger is, from any source, in the plate's frame, and its velocity."""
