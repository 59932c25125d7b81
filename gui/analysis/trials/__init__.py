"""The table of the trials of one session or several: sorted, filtered, and followed."""
