"""The boards' firmware compiled for this computer."""
