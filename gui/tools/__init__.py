"""Commands of the command line as pages of the window, with the same words."""
