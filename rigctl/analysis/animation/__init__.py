"""Movies of any figure: GIF, MP4, or the last frame as PNG."""
