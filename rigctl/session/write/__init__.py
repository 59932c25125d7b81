"""The recorder and the files that it writes."""
