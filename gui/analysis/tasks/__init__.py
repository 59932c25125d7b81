"""Worker processes of the window: their tasks, and the values that they exchange with it."""
