"""Long runs with make targets of their own; the suite does not collect them."""
