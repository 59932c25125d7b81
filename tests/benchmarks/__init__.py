"""Benchmarks: figures of ours and of a peer from the same run; ``make bench`` runs them all."""
