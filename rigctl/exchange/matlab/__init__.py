"""MATLAB files, checked before anything in them is believed."""
