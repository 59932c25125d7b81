"""The simulated bench: one world, virtual boards, and the real images on simulated chips."""
