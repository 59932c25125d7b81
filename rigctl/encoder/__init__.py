"""Samples to spikes: the neuron kernel, SA and RA channels, speed scaling, features."""
