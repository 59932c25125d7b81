"""Several clients of one engine: which one has control, what they missed, and live data for all."""
