"""The virtual finger: an operator who slides the bench's skin over flat plates."""
