"""Put a crashed or damaged session in order; the originals stay as they are, in quarantine."""
