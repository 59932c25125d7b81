"""Faults in a real engine's process that no client can cause; ``sitecustomize`` makes them."""
