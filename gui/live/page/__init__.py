"""The page of the live plots: controls above them, readings at the cursor below them."""
