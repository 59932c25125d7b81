"""The constants of the analysis: the paper's, or those of an analysis file."""
