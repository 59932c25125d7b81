"""A session on disk: layout, recorder, reader, verify."""
