"""Tests of the window: an engine joined, shared and left."""
