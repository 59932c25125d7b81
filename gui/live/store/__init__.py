"""The last minutes of samples, spikes, force and speed, for views that look back."""
