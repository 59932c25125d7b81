"""The learning curve on the page of a run."""
