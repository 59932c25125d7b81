"""Mean reading of each layer, and how much the neurons fire: curves for the window."""

import numpy as np


def curves(block):
    top, bottom = np.array_split(block.samples, 2, axis=1)
    sa, ra = np.array_split(block.spikes, 2, axis=1)
    rate = 1000 / len(block)  # blocks of a sample or many, at 1,000 samples a second
    return {
        "top layer": (top.mean(axis=1), "counts"),
        "bottom layer": (bottom.mean(axis=1), "counts"),
        "SA": (sa.sum() * rate, "spikes/s"),
        "RA": (ra.sum() * rate, "spikes/s"),
    }
