"""One scan: between the marks on the board, judged, recorded and answered."""
