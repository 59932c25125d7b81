"""The window's connection to an engine: started, joined, shared with other windows, left behind."""
