"""What a session says of itself before its first sample: its header, sensor and wiring."""
