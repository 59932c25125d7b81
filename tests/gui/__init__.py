"""The window, driven by clicks, without a display."""
