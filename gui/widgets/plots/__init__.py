"""What the plots of several panels share: axes, grids, and the veil over old data."""
