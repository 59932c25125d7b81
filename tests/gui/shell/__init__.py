"""Tests of the window: the window around all pages, and whole days in it."""
