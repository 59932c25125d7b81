"""Figures with the peer beside them; ``make bench`` runs them all."""
