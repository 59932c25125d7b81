"""Long runs with separate make targets; the suite does not collect them."""
