"""Bytes to values and back: no port, thread or clock lives here."""
