"""The parameters of a simulated bench, and the world files that set them."""
