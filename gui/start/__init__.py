"""What a user sees who opens the window for the first time."""
