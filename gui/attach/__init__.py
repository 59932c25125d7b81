"""Engines that run already: found, joined, shared with other windows, left behind."""
