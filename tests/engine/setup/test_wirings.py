"""A setup through every wrong wiring: one right sentence each, and no force that hurts."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.bench.wirings import WIRINGS
from rigctl.rig import FIRMWARE
from tests.engine.setup.simulated_setup import simulated_setup
from tests.engine.setup.wrong_wirings import MOST_FORCE_G, set_up

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "wrong-wirings.md"
ON_CHIPS_ALONE = {name for name, wiring in WIRINGS.items() if wiring.reaches == "chips"}


@pytest.fixture(scope="module")
def page() -> list[str]:
    return PAGE.read_text(encoding="utf-8").splitlines()


def test_the_catalogue_has_forty_wirings_and_the_page_a_row_for_each(page: list[str]) -> None:
    rows = [line.split("`")[1] for line in page if line.startswith("| `")]
    assert len(WIRINGS) >= 40
    assert sorted(rows) == sorted(WIRINGS)


@pytest.mark.parametrize("name", [name for name in WIRINGS if name not in ON_CHIPS_ALONE])
def test_a_setup_names_a_wrong_wiring_and_presses_gently(name: str, page: list[str]) -> None:
    row = set_up(name)
    assert name in row.causes
    assert row.peak_g <= MOST_FORCE_G
    assert row.line in page  # else: make docs


def test_wirings_that_no_sensor_tells_apart_share_a_sentence() -> None:
    groups: dict[str, set[str]] = {}
    for name in ("stepper coil reversed", "direction reversed", "8 microsteps", "belt 2:1"):
        groups.setdefault(set_up(name).sentence, set()).add(name)
    assert sorted(map(sorted, groups.values())) == [
        ["8 microsteps", "belt 2:1"],
        ["direction reversed", "stepper coil reversed"],
    ]


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("taxel inputs shorted", "sensor"),
        ("taxel divider missing", "sensor"),
        ("potentiometer wiper open", "actuator"),
        ("actuator swapped", "actuator"),
        ("cell excitation open", "finger"),
        ("end switches swapped", "ends"),
    ],
)
def test_on_chips_the_electrics_say_the_same(name: str, part: str) -> None:
    with simulated_setup(name, FIRMWARE) as setup:
        result = setup.run_part(part)
        assert name in result.causes and setup.peak_g == 0


@pytest.mark.parametrize("part", ["stop", "ends", "scale"])
def test_noise_on_the_switches_of_chips_is_filtered(part: str) -> None:
    with simulated_setup("noise on switches", FIRMWARE) as setup:
        assert setup.run_part(part).passed


@pytest.mark.parametrize(
    ("wirings", "part"),
    [
        (("actuator swapped", "potentiometer reversed"), "actuator"),
        (("E-stop unplugged", "cell data unplugged"), "stop"),
        (("cell at 10 samples a second", "actuator swapped"), "cell"),
        (("index missing", "stepper coil reversed"), "turn"),
        (("cell excitation open", "actuator supply half"), "finger"),
    ],
)
def test_of_two_wrong_wirings_one_is_named_before_anything_presses(
    wirings: tuple[str, str], part: str
) -> None:
    with simulated_setup(wirings[0]) as setup:
        setup.rig.faults.wire(wirings[1])
        setup.run_through()
        assert setup.step is not None and setup.step.name == part
        assert setup.wrong is not None and set(wirings) & set(setup.wrong.causes)
        assert setup.peak_g == 0


def test_a_rig_that_is_wired_as_drawn_passes_and_is_commissioned() -> None:
    with simulated_setup() as setup:
        setup.run_through()
        assert setup.wrong is None and setup.step is not None and setup.step.name == "trial"
        assert 80 < setup.peak_g <= MOST_FORCE_G


def test_a_press_of_a_kilogram_would_be_seen() -> None:
    """The bench's record of the force is what the bound is held against."""
    with simulated_setup() as setup:

        async def push(_: object) -> None:
            context = setup.rig.simulation._bench
            context.plant.set_rod(context.parameters.contact_mm + 1.5)

        setup.run(push)
        assert setup.peak_g > MOST_FORCE_G


def test_the_whole_setup_passes_on_chips() -> None:
    with simulated_setup(kind=FIRMWARE) as setup:
        setup.run_through()
        assert setup.wrong is None and 80 < setup.peak_g <= MOST_FORCE_G
