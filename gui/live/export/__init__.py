"""What is on the screen as a picture or a table."""
