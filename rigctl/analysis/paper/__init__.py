"""The paper's tasks, statistics and comparisons."""
