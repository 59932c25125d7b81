"""Responses of a neuron in several conditions, side by side."""
