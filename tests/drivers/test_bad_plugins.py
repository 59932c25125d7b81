"""Packages that cannot be used: one sentence each, the others and the recording untouched."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from rigctl.analysis.further_tasks import TASK_FAMILIES
from rigctl.cli.doctor import State, check_plugins, lookups
from rigctl.config.rig_config import parse_config
from rigctl.errors import WrongUse
from rigctl.exchange.export.formats import FORMATS
from rigctl.plugins import installed
from rigctl.rig import open_rig
from rigctl.session.verify import verify
from tests.drivers.support import install_module
from tests.drivers.test_sensor import LEVEL, PROTOCOL, RIG
from tests.engine.engine_harness import EngineHarness, engine_on

SENSOR = "[rigctl.sensors]\nx = bad_sensor:X\n"
WHOLE = """
class X:
    baud, n_taxels, rate_hz, full_scale, counter_modulus = 9600, 18, 1000, 1023, 65536
    has_sync, request = True, b""
    def decode(self, data): return None
"""
ASK = "install another version of bad-sensor, or ask its author"
BAD: list[tuple[str, str, str]] = [
    (
        "import no_such_module",
        "rigctl",
        f"sensor x of bad-sensor 1.0 failed (ModuleNotFoundError: "
        f"No module named 'no_such_module'): {ASK}",
    ),
    (
        "",
        "rigctl",
        "sensor x of bad-sensor 1.0 failed (AttributeError: module 'bad_sensor' has no "
        f"attribute 'X'): {ASK}",
    ),
    (
        "class X: pass",
        "rigctl",
        "sensor x of bad-sensor 1.0 is no sensor, it lacks baud, "
        "counter_modulus, decode, full_scale, has_sync, n_taxels, rate_hz, request: " + ASK,
    ),
    (
        WHOLE,
        "rigctl>=2,<3",
        "sensor x of bad-sensor 1.0 is made for rigctl <3,>=2, this is 0.1.0: "
        "pip install --upgrade bad-sensor, or take the rigctl that it is made for",
    ),
    (
        WHOLE.replace("1000", "500"),
        "rigctl",
        "nominal: the sensor x of bad-sensor 1.0 gives 500 "
        "samples a second and rigctl records 1000: let the driver or its board give as many",
    ),
    (
        WHOLE.replace("True", "False"),
        "rigctl",
        "nominal: the sensor x of bad-sensor 1.0 reads no sync line: set [signals] sync = false",
    ),
    (
        WHOLE.replace("18", "12"),
        "rigctl",
        "nominal: [taxels] count is 18, the sensor x of bad-sensor 1.0 has 12: set count = 12",
    ),
    (
        WHOLE,
        "rigctl",
        "the sensor x of bad-sensor 1.0 cannot be rehearsed, it has no encode: leave "
        "[ports] simulate out, or ask its author",
    ),
]


@pytest.mark.parametrize(("source", "requires", "sentence"), BAD)
def test_a_rig_with_it_is_refused_in_a_sentence(
    site: Path, source: str, requires: str, sentence: str
) -> None:
    install_module(site, "bad-sensor", SENSOR, source, requires)
    with pytest.raises(WrongUse) as refusal:
        open_rig("virtual", config=parse_config('[taxels]\ndriver = "x"\n'))
    assert str(refusal.value) == sentence


def test_a_name_that_nothing_has_is_refused() -> None:
    with pytest.raises(WrongUse, match="no sensor y: choose from rigctl, or install the package"):
        open_rig("virtual", config=parse_config('[taxels]\ndriver = "y"\n'))


def test_a_driver_without_a_port_is_refused(examples: Path, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG.replace("simulate", "#"))
    with pytest.raises(WrongUse, match=r"no board of the sensor teensy16: name its port"):
        open_rig(str(path))


def test_two_of_a_name_and_one_of_ours_are_refused_alone(site: Path) -> None:
    for package in ("one-lab", "two-lab"):
        entries = "[rigctl.exporters]\nsame = lab:X\n"
        install_module(site, package, entries + ("csv = lab:X\n" if package == "two-lab" else ""))
    with pytest.raises(WrongUse) as refusal:
        FORMATS.load("same")
    cure = "pip uninstall two-lab, or ask its author for another name"
    assert str(refusal.value) == f"one-lab and two-lab each bring the exporter same: {cure}"
    with pytest.raises(WrongUse) as refusal:
        FORMATS.load("csv")
    assert str(refusal.value) == f"rigctl and two-lab each bring the exporter csv: {cure}"
    assert FORMATS.load("parquet").title == "Parquet"
    found = list(check_plugins(lookups()))
    assert {finding.state for finding in found} == {State.ATTENTION}
    assert found[0].cure == cure and len(found) == 3


def test_a_task_under_one_of_our_keys_is_refused(site: Path) -> None:
    source = """
from rigctl.analysis.further_tasks import Family
from rigctl.analysis.published import Task
X = Family("x", "X", (Task("textures", "T", "", "x"),), lambda design, random: [])
"""
    install_module(site, "lab", "[rigctl.tasks]\nx = lab:X\n", source)
    with pytest.raises(WrongUse, match=r"task x of lab 1.0 has a wrong name or family in textures"):
        TASK_FAMILIES.load("x")


def test_doctor_lists_what_is_there(examples: Path) -> None:
    found = [(one.state, one.sentence) for one in check_plugins(lookups())]
    assert found == [
        (State.OK, "sensor teensy16 of rigctl-teensy16 1.2.0"),
        (State.OK, "actuator step-axis of rigctl-step-axis 0.3.1"),
    ]


def test_doctor_says_that_there_is_none(site: Path) -> None:
    assert [one.sentence for one in check_plugins(lookups())] == ["no package brings one"]


FAILING = """
from rigctl_teensy16 import Teensy16

class Failing(Teensy16):
    samples = 0

    def decode(self, data):
        found = super().decode(data)
        Failing.samples += len(found.counters)
        if 9000 < Failing.samples < 9100:
            raise IndexError("frame 9000")
        return found
"""


@pytest.fixture
def failing(examples: Path, site: Path, tmp_path: Path) -> Iterator[EngineHarness]:
    install_module(site, "failing", "[rigctl.sensors]\nfailing = failing:Failing\n", FAILING)
    installed.cache_clear()
    config = parse_config(RIG.replace("teensy16", "failing"))
    rig = open_rig("virtual", seed=3, paced=False, config=config, world=LEVEL)
    with engine_on(rig, tmp_path) as harness:
        yield harness


def test_a_driver_that_fails_in_a_run_is_a_lost_link(failing: EngineHarness) -> None:
    run = failing.record(PROTOCOL.replace("repeats = 4", "repeats = 1"))
    said = [event.text for event in failing.events if event.kind == "link"]
    assert said[0].startswith("sensor failing of failing 1.0 failed (IndexError: frame 9000): ")
    assert run.outcome == "done" and verify(failing.session).whole
