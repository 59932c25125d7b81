"""One taxel of one trial on its way through the encoder: as figure, table and movie."""
