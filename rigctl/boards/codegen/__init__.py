"""Generate the firmware's headers and the reference page from the drum's tables."""
