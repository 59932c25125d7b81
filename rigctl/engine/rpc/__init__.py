"""Requests, replies and events between the engine and its clients."""
