"""Encoding and decoding of both boards' wires: no port, thread or clock."""
