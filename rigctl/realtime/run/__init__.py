"""A run of the protocol: its request, its scans in order, its status."""
