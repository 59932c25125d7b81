"""Recording by hand."""
