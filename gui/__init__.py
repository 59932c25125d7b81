"""The window: panels that show and ask; the only room that knows Qt."""
