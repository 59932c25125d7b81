"""The moving finger: scans, models, how sure they are, and Figures 4B, 4C and S5."""
