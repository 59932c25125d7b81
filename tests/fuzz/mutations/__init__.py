"""Damage of every kind, each made from a random generator."""
