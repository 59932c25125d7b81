"""Spikes of another encoder than the engine's, computed as the samples arrive."""
