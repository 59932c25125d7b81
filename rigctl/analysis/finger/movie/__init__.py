"""The movie of a recorded scan: its values at each moment, their picture, and the file."""
