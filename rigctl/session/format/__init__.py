"""The layout of a session on disk: tables, columns, attributes, header, lock."""
