"""``rig.toml`` has a default for every key, is written and read back, and mistakes are named."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.config.rig_config import (
    About,
    DrumGeometry,
    RigConfig,
    RigLimits,
    TaxelArray,
    load_config,
    parse_config,
)
from rigctl.errors import ConfigError

TEXT = st.text(st.characters(codec="utf-8"), max_size=40)


def test_an_empty_file_is_the_nominal_rig() -> None:
    assert parse_config("") == RigConfig()


@given(TEXT, TEXT, st.floats(50, 300), st.booleans(), st.permutations(range(18)))
def test_written_description_reads_back_equal(
    operator: str, sensor: str, length: float, raises: bool, wiring: list[int]
) -> None:
    config = RigConfig(
        about=About("rig", operator, sensor),
        drum=DrumGeometry(plate_length_mm=length),
        taxels=TaxelArray(
            pressure_raises=raises,
            wiring=tuple(wiring),
            low=tuple(range(18)),
            high=tuple(range(900, 918)),
            range_from="20 trials of A",
        ),
    )
    assert parse_config(config.to_toml()) == config


def test_arguments_of_a_command_may_be_equal_and_empty() -> None:
    config = parse_config('[run]\non_event = ["mail", "-s", "", "-s", "a b"]')
    assert config.run.on_event == ("mail", "-s", "", "-s", "a b")
    assert parse_config(config.to_toml()) == config


def test_written_file_explains_every_key() -> None:
    text = RigConfig().to_toml()
    for section in fields(RigConfig):
        for item in fields(type(section.default)):  # type: ignore[arg-type]
            assert f"\n{item.name} = " in text
            assert item.metadata["doc"] in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[drum]\nplate_lenght_mm = 3", ["line 2", "did you mean 'plate_length_mm'"]),
        ("[limts]", ["line 1", "did you mean 'limits'"]),
        ("[drum]\n\nrun_in_mm = 'long'", ["line 3: drum.run_in_mm", "must be a number"]),
        ("[signals]\nestop = 1", ["line 2: signals.estop", "must be true or false"]),
        ("[limits]\nspeed_max_mm_s = 500", ["line 2", "outside 5 to 200 mm/s"]),
        ("[taxels]\nlow = [1, 2]\nhigh = [3, 4]", ["line 2", "2 entries for 18 taxels"]),
        ("[taxels]\ncount = 1\nlow = [5]\nhigh = [5]", ["line 3", "below its high"]),
        ("[taxels]\ncount = 1\nlow = [5]", ["taxels.high", "both low and high"]),
        ("[taxels]\ncount = 2\nwiring = [1, 1]", ["line 3", "each of 0 to 1 once"]),
        ("[drum]\nplate_length_mm = 395", ["line 2", "beyond the turn"]),
        ("[limits]\nover_force_g = 1250", ["line 2", "10 % above force_max_g"]),
        ("[run]\non_event = 'mail anna'", ["line 2: run.on_event", "a list of texts"]),
        ("[run]\non_event = ['mail', '-s', 3]", ["line 2", "a list of texts"]),
        ('[run]\non_event = ["a\\u0000"]', ["line 2", "U+0000"]),
        ("[limits]\nforce_min_g = 1300", ["line 2", "above force_max_g"]),
        ("[loadcell]\nscale_ug_per_count = 0", ["line 2: loadcell.scale", "too little"]),
        ("[loadcell]\n\nscale_ug_per_count = 199", ["line 3", "200 to 25000", "calibrate it"]),
        ("[loadcell]\nscale_ug_per_count = -1", ["line 2", "too little"]),
        ("[loadcell]\nscale_ug_per_count = 1000000", ["line 2", "-25000 to 25000"]),
        ("[loadcell]\nscale_ug_per_count = -25001", ["line 2", "-25000 to 25000"]),
        ("[loadcell]\nrate_hz = 40", ["line 2: loadcell.rate_hz", "80 samples a second, or 10"]),
        ("[loadcell]\nrate_hz = 10", ["line 2", "set gain_p_per_s = 4 and gain_i_per_s = 1.5"]),
        (
            "[actuator]\ngain_p_per_s = 4\n[loadcell]\nrate_hz = 10",
            ["line 4: loadcell.rate_hz", "gains of 4 and 5"],
        ),
        ("[about]\nname = ", ["not TOML"]),
    ],
)
def test_a_mistake_names_file_line_and_key(text: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "lab.toml")
    for word in ["lab.toml", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize("scale", [200, 2400, 25000, -200, -2400])
def test_possible_scale_of_a_load_cell_is_accepted(scale: int) -> None:
    text = f"[loadcell]\nscale_ug_per_count = {scale}"
    assert parse_config(text).loadcell.scale_ug_per_count == scale


def test_ten_samples_a_second_are_accepted_with_slow_gains() -> None:
    text = "[actuator]\ngain_p_per_s = 4\ngain_i_per_s = 1.5\n[loadcell]\nrate_hz = 10"
    assert parse_config(text).loadcell.rate_hz == 10


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot read .*rig\.toml"):
        load_config(tmp_path / "rig.toml")


def test_limits_of_the_nominal_rig_allow_the_forces_of_the_paper() -> None:
    assert RigLimits().force_max_g >= 1000
    assert replace(RigLimits(), force_max_g=1000).over_force_g > 1000
