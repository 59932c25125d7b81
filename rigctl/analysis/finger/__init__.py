"""The moving finger: scans, classifiers and models, how sure they are, and Figures 4B, 4C and S5."""
