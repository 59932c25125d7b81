"""Panels that choose, plan and watch a protocol."""
