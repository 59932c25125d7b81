"""Print the rate over input of each preset's neuron: ``python -m rigctl.encoder.rate_table``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.encoder import Encoder
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import MODEL_PRESETS, PRESETS, SA_PRESETS, EncoderParameters

SETTLE_S = 1
COUNT_S = 20
TABLE_INPUTS = (0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
RESOLUTION = 1000


def steady_sa_rates_hz(
    parameters: EncoderParameters, inputs: Sequence[float]
) -> NDArray[np.float64]:
    """Return the SA rate for constant normalised inputs (0–1, to three decimals), float64, Hz.

    Counted over 20 s after 1 s from rest.
    """
    low = np.zeros(len(inputs), np.uint16)
    ranges = Normalisation(low, low + np.uint16(RESOLUTION), "inputs in thousandths")
    encoder = Encoder(ranges, parameters)
    readings = np.round(np.asarray(inputs) * RESOLUTION).astype(np.uint16)
    rate_hz = round(parameters.sample_rate_hz)
    encoder.encode(np.tile(readings, (SETTLE_S * rate_hz, 1)))
    counts = encoder.encode(np.tile(readings, (COUNT_S * rate_hz, 1)))
    rates: NDArray[np.float64] = counts[:, : len(inputs)].sum(axis=0) / float(COUNT_S)
    return rates


def markdown_table() -> str:
    """Return SA rates in Hz as a Markdown table, one row an input, one column a preset.

    Presets that differ from the default in the RA channel alone are left out.
    """
    names = (*SA_PRESETS, *MODEL_PRESETS)
    columns = {name: steady_sa_rates_hz(PRESETS[name], TABLE_INPUTS) for name in names}
    lines = ["| x | " + " | ".join(columns) + " |", "|---:|" + "---:|" * len(columns)]
    for row, x in enumerate(TABLE_INPUTS):
        cells = " | ".join(f"{rates[row]:.1f}" for rates in columns.values())
        lines.append(f"| {x:g} | {cells} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown_table())
