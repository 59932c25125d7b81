"""Files beside a session: models, spikes, force matrices, ground truth."""
