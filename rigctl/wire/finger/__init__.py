"""The finger board's frames: samples with spikes, scaled windows, requests and settings."""
