"""The measurement of rounding: what it compares is the kernel's neuron, in two other orders."""

from __future__ import annotations

import numpy as np

from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT
from tests.encoder.textbook_order import as_spikes, factored, printed, raster


def test_the_orders_have_the_kernels_trains_where_neurons_fire_well() -> None:
    random = np.random.default_rng(3)
    level = np.linspace(400, 1000, 18)
    samples = (level + random.normal(0, 5, (800, 18))).clip(0, 1023).astype(np.uint16)
    ranges = Normalisation.full_scale(18)
    (kernel,) = encode_trials([samples], ranges, DEFAULT)
    for respond in (printed, factored):
        spikes = as_spikes(raster(respond, samples, ranges))
        assert np.array_equal(spikes.row_start[:19], kernel.row_start[:19])
        for row in range(18):
            np.testing.assert_array_equal(spikes.train(row), kernel.train(row))
