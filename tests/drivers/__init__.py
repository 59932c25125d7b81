"""Drivers from outside: example packages, and what becomes of them."""
