"""Taxel samples from the driver to recorder, encoder and live buffer, and cut into trials."""
