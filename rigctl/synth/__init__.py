"""Virtual data sets: a protocol on the simulated bench without waiting for time to pass."""
