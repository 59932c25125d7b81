"""The encoder's parameters and presets: what they refuse, how they are kept, their rates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.encoder.parameters import PRESETS, SA_PRESETS, EncoderParameters, preset
from rigctl.encoder.rate_table import markdown_table, steady_sa_rates_hz
from rigctl.errors import WrongUse

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "encoding.md"


def test_rates_rise_with_the_input_and_lock_in_published_schemes() -> None:
    inputs = np.arange(1, 101) / 100
    rates = {name: steady_sa_rates_hz(preset(name), list(inputs)) for name in SA_PRESETS}
    assert (np.diff(rates["default"]) >= -0.1).all()
    assert len(np.unique(rates["default"])) > 60
    # Published schemes with long steps lock many inputs to whole milliseconds between spikes.
    locked = (125.0, 1000 / 6, 200.0, 250.0)
    hits = [min(abs(rate - lock) for lock in locked) < 0.1 for rate in rates["izhikevich2003"]]
    assert np.mean(hits) > 0.3
    assert (np.diff(rates["izhikevich2003"]) < 0).any()
    # A quarter of the model time gives about a quarter of the rate.
    assert 0.2 < rates["quarter-rate"][50] / rates["default"][50] < 0.3


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"substeps": 0}, "substeps"),
        ({"a": float("nan")}, "a is nan"),
        ({"ra_lowpass_hz": 500.0}, "ra_lowpass_hz"),
        ({"ra_order": 0}, "ra_order"),
        ({"ra_order": 9}, "ra_order"),
        ({"substep_ms": 0.0}, "substep_ms"),
        ({"c_mv": 40.0}, "c_mv"),
    ],
)
def test_impossible_parameters_are_refused(change: dict[str, Any], word: str) -> None:
    with pytest.raises(WrongUse, match=word):
        replace(preset("default"), **change)


def test_parameters_survive_storage_and_typos_are_named() -> None:
    for parameters in PRESETS.values():
        assert EncoderParameters.from_dict(parameters.as_dict()) == parameters
    with pytest.raises(WrongUse, match="sa_gian"):
        EncoderParameters.from_dict({"sa_gian": 1.0})
    with pytest.raises(WrongUse, match="absolute"):
        EncoderParameters.from_dict({"ra_rectify": "up"})
    with pytest.raises(WrongUse, match="quarter-rate"):
        preset("fast")


def test_the_table_of_rates_in_the_reference_is_fresh() -> None:
    assert markdown_table() in PAGE.read_text(encoding="utf-8")


def test_the_reference_explains_every_preset() -> None:
    rows = PAGE.read_text(encoding="utf-8").splitlines()
    for name in PRESETS:
        (*_, source) = next(row for row in rows if row.startswith(f"| `{name}` |")).split("|")[:-1]
        assert source.strip()
