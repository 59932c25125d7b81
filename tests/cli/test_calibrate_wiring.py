"""``rigctl calibrate wiring`` with a simulated person who follows the instructions, or does not."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from rigctl.cli import calibrate_wiring, main
from rigctl.config.rig_config import RigConfig, load_config
from rigctl.errors import LinkLost, RigFault
from rigctl.values import DRAWN_WIRING, Block
from tests.boards.memory_link import JumpingLoop
from tests.engine.calibration.pressed_sensor import PER_LAYER, PressedSensor, wiring_of

SOLDERED = wiring_of([2, 0, 1], [4, 1, 0, 5, 3, 2], False)
RIG = """\
# Mine.
[taxels]
wiring = [ # as found in March
  0, 1, 2, 3, 4, 5, 6, 7, 8,
  9, 10, 11, 12, 13, 14, 15, 16, 17,
]
low = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17]
high = [100, 101, 102, 103, 104, 105, 106, 107, 108, 109, 110, 111, 112, 113, 114, 115, 116, 117]
"""


class PressedTaxels:
    """A taxel board that sends the readings of its sensor 20 times a second."""

    def __init__(self, loop: JumpingLoop, sensor: PressedSensor) -> None:
        self.sensor = sensor
        self.pressed: list[int] = []
        self.unplugged = False
        self.lost: RigFault | None = None
        self._loop = loop
        self._consumers: list[Callable[[Block], None]] = []
        self._fault: Callable[[RigFault], None] = lambda fault: None

    def on_block(self, consumer: Callable[[Block], None]) -> Callable[[], None]:
        self._consumers.append(consumer)
        return lambda: self._consumers.remove(consumer)

    def on_fault(self, consumer: Callable[[RigFault], None]) -> None:
        self._fault = consumer

    async def connect(self) -> None:
        self._send()

    def _send(self) -> None:
        if self.lost is not None:
            self._fault(self.lost)
            return
        row = self.sensor.press(self.pressed, self.unplugged)
        samples = np.tile(row.round().astype(np.uint16), (50, 1))
        zeros = np.zeros(50, np.uint8)
        block = Block(np.arange(50, dtype=np.int64), samples, zeros, zeros, (), self._loop.time())
        for consume in tuple(self._consumers):
            consume(block)
        self._loop.call_later(0.05, self._send)


class Person:
    """Follows the instructions in the order of ``places`` and keeps them in ``questions``."""

    def __init__(self, taxels: PressedTaxels, places: list[int]) -> None:
        self.questions: list[str] = []
        self._taxels = taxels
        self._places = iter(places)

    def __call__(self, text: str) -> str:
        self.questions.append(text)
        taxels = self._taxels
        taxels.pressed = []
        if text.startswith("Unplug"):
            taxels.unplugged = True
        elif text.startswith("Plug"):
            taxels.unplugged = False
        elif "flat" in text:
            taxels.pressed = list(range(PER_LAYER))
        else:
            taxels.pressed = [next(self._places)]
        return ""


class TaxelRig:
    """A rig without a drum, opened with the order of the wire."""

    def __init__(self, config: RigConfig, taxels: PressedTaxels, loop: JumpingLoop) -> None:
        assert config.taxels.order == tuple(range(18))
        self.config, self.taxels, self.loop = config, taxels, loop

    def touch_sensor(self, places: Sequence[int], unplugged: bool) -> bool:
        return False

    def close(self) -> None:
        self.loop.close()


@pytest.fixture
def taxels(monkeypatch: pytest.MonkeyPatch) -> Iterator[PressedTaxels]:
    loop = JumpingLoop()
    board = PressedTaxels(loop, PressedSensor(SOLDERED))
    monkeypatch.setattr(
        calibrate_wiring, "open_rig", lambda spec, config: TaxelRig(config, board, loop)
    )
    yield board
    loop.close()


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    return path


def calibrate(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    places: list[int],
    *words: str,
) -> tuple[int, Person]:
    person = Person(taxels, places)
    monkeypatch.setattr("builtins.input", person)
    return main(["calibrate", "--rig", str(rig), *words, "wiring"]), person


def test_nine_presses_after_unplugging_find_and_save_the_order(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, person = calibrate(rig, taxels, monkeypatch, list(range(9)))
    assert code == 0
    assert len(person.questions) == 3 + PER_LAYER
    said = capsys.readouterr().out
    assert "top layer: inputs A0, A1, A4; bottom layer: inputs A2, A3, A5" in said
    assert "row 1, column 1: D6·A4 by 300 counts, below it D6·A5 by 198 counts" in said
    assert f"wiring = {list(SOLDERED)}\nsaved in {rig}" in said
    written = load_config(rig).taxels
    assert written.wiring == SOLDERED
    # The ranges move with the readings to their new places.
    assert written.low == SOLDERED
    assert written.high == tuple(100 + reading for reading in SOLDERED)
    assert rig.read_text().startswith("# Mine.\n[taxels]\nwiring = [")


def test_unclear_press_is_repeated(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, person = calibrate(rig, taxels, monkeypatch, [0, 0, *range(1, 9)])
    assert code == 0
    assert "not clear: D6·A4 responded, as it did at row 1, column 1" in capsys.readouterr().out
    assert [text.startswith("Press row 1, column 2") for text in person.questions].count(True) == 2


def test_contradictory_presses_leave_the_file_unchanged(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, _ = calibrate(rig, taxels, monkeypatch, [0, 1, 2, 4, 3, 5, 6, 7, 8])
    assert code == 2
    assert "do not form rows of one line" in capsys.readouterr().err
    assert rig.read_text() == RIG


def test_dry_saves_nothing_and_json_has_the_order(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, _ = calibrate(rig, taxels, monkeypatch, list(range(9)), "--dry", "--json")
    assert code == 0
    assert json.loads(capsys.readouterr().out) == {
        "part": "wiring", "rig": str(rig), "wiring": list(SOLDERED),
    }  # fmt: skip
    assert rig.read_text() == RIG


def test_ranges_of_an_unknown_order_are_removed(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rig.write_text(f"[taxels]\nlow = {[1] * 18}\nhigh = {[2] * 18}\n")
    assert calibrate(rig, taxels, monkeypatch, list(range(9)))[0] == 0
    assert "calibrate them again" in capsys.readouterr().out
    assert (load_config(rig).taxels.low, load_config(rig).taxels.wiring) == ((), SOLDERED)


def test_lost_board_ends_the_calibration(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    taxels.lost = LinkLost("/dev/ttyACM0: no taxel sample for 0.2 s: check the cable")
    assert calibrate(rig, taxels, monkeypatch, [])[0] == 3
    assert "check the cable" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words", "sentence"),
    [
        ("", ["--yes"], "needs a person who unplugs"),
        ('[ports]\nsimulate = "virtual"', [], "a simulated sensor is soldered as drawn"),
        ("[taxels]\nrows = 1\ncolumns = 9", [], "3 × 3 taxels in two layers"),
    ],
)
def test_rig_without_a_person_or_a_sensor_is_refused(
    rig: Path, text: str, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rig.write_text(text)
    assert main(["calibrate", "--rig", str(rig), *words, "wiring"]) == 2
    assert sentence in capsys.readouterr().err


def test_order_of_the_drawing_is_named(
    rig: Path,
    taxels: PressedTaxels,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    taxels.sensor = PressedSensor(DRAWN_WIRING)
    assert calibrate(rig, taxels, monkeypatch, list(range(9)), "--dry")[0] == 0
    assert "as drawn\nnothing was saved (--dry)" in capsys.readouterr().out
