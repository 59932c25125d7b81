"""The boards' images on simulated AVR chips."""
