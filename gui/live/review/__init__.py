"""Looking back while recording goes on: pause, scroll, zoom, cursors and marks."""
