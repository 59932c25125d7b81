"""Conditions that end before their repeats: a process of its own judges what is recorded."""
