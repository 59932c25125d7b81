"""Pictures and tables of what the Analysis tab shows, as files."""
