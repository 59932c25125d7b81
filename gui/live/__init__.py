"""Live plots of samples, spikes, force and speed, and the health strip."""
