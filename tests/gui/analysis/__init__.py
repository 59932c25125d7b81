"""Tests of the window: recorded sessions."""
