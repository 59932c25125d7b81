"""The page Set up: a rig from wired parts to its first trial, part by part."""
