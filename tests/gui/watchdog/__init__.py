"""Watch the Qt thread: what makes it sleep or work while the window should answer."""
