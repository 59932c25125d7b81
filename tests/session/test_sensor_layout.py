"""Rows, columns and layers of a sensor: stored with the session, by default from its taxels."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.config.rig_config import TaxelArray, parse_config
from rigctl.errors import ConfigError, SessionError
from rigctl.session.header import SessionHeader
from rigctl.session.recorder import Recorder
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.session import Session
from rigctl.session.summary import summarise_session
from rigctl.session.verify import verify
from tests.session.building import PROTOCOL, RIG, header

PAPER = SensorLayout(3, 3, ("I", "II"))


def record(folder: Path, layout: SensorLayout | None, resume: bool = False) -> None:
    of = replace(header(), sensor_layout=layout)
    with Recorder(folder, of, PROTOCOL, RIG, resume=resume) as recorder:
        recorder.begin_part("A", "A")


def test_the_papers_sensor_has_its_names() -> None:
    names = [name for name, _ in PAPER.train_names()]
    assert names[:10] == [f"SAI-{i}" for i in range(1, 10)] + ["RAI-1"]
    assert names[18] == "SAII-10" and names[-1] == "RAII-18"
    assert [row for _, row in PAPER.train_names()][8:11] == [8, 18, 19]
    assert PAPER.names[0] == "I-1" and PAPER.names[-1] == "II-18"
    assert (PAPER.layer_of(8), PAPER.layer_of(9), PAPER.row_of(14)) == (0, 1, 1)


@pytest.mark.parametrize("n_taxels", [1, 9, 16, 10])
def test_one_layer_is_not_split(n_taxels: int) -> None:
    layout = SensorLayout.default(n_taxels)
    assert layout.n_taxels == n_taxels and len(layout.layers) == 1
    assert {layout.layer_of(taxel) for taxel in range(n_taxels)} == {0}
    numbers = range(1, n_taxels + 1)
    expected = [f"{channel}-{number}" for channel in ("SA", "RA") for number in numbers]
    assert [name for name, _ in layout.train_names()] == expected
    assert layout.names == tuple(map(str, numbers))


@pytest.mark.parametrize(
    ("rows", "layers", "words"),
    [
        (1, [f"layer {k}" for k in range(20_000)], "in 20000 layers (layer 0, layer 1"),
        (1, ["I" * 20_000], "is longer than 24 bytes"),
        (1, ["I"] * 1000, "two layers have the same name: I"),
        (10**9, ["I"], "are more than 1024 taxels"),
        (1, [f"layer {k}" for k in range(1000)], "(layer 0, layer 1, layer 2, layer 3"),
    ],
)
def test_a_layout_of_any_size_is_refused_in_a_sentence(
    rows: int, layers: list[str], words: str
) -> None:
    values = {"rows": rows, "columns": 1, "layers": layers}
    with pytest.raises(SessionError) as refused:
        SessionHeader.from_attributes(
            {
                **header().to_attributes(),
                "n_taxels": 3,
                "taxel_low": "[]",
                "taxel_high": "[]",
                "sensor_layout": json.dumps(values),
            },
            Path("part.h5"),
        )
    assert words in str(refused.value)
    assert len(str(refused.value)) < 300


def test_a_square_has_its_sides_and_other_numbers_one_row() -> None:
    assert (SensorLayout.default(16).rows, SensorLayout.default(16).columns) == (4, 4)
    assert (SensorLayout.default(10).rows, SensorLayout.default(10).columns) == (1, 10)


def test_layers_with_words_as_names_are_read_as_words() -> None:
    names = [name for name, _ in SensorLayout(1, 2, ("skin", "core")).train_names()]
    assert names[0] == "SA skin-1" and names[-1] == "RA core-4"


@pytest.mark.parametrize(
    ("taxels", "expected"),
    [
        (TaxelArray(), PAPER),
        (TaxelArray(count=9), SensorLayout(3, 3, ("I",))),
        (TaxelArray(count=16), SensorLayout(4, 4, ("I",))),
        (TaxelArray(count=12, rows=2, columns=2), SensorLayout(2, 2, ("I", "II", "III"))),
        (TaxelArray(rows=3, columns=6, layers=("skin",)), SensorLayout(3, 6, ("skin",))),
    ],
)
def test_a_rig_describes_its_sensor(taxels: TaxelArray, expected: SensorLayout) -> None:
    assert SensorLayout.of_rig(taxels) == expected


def test_a_rig_with_layers_reads_back() -> None:
    text = '[taxels]\nrows = 3\ncolumns = 2\nlayers = ["a", "b", "c"]\n'
    config = parse_config(text)
    assert config.taxels.layers == ("a", "b", "c")
    assert parse_config(config.to_toml()) == config


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('layers = ["I", "II", "III"]', "place 27 taxels, count is 18"),
        ('layers = ["I", "I"]', "twice"),
        ('layers = ["I", ""]', "must contain texts"),
        ('layers = "I"', "must be a list of texts"),
        ('layers = ["I", "a/b"]', "contains '/'"),
    ],
)
def test_a_mistake_names_the_line(text: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=rf"rig.toml, line 2: taxels.layers: .*{problem}"):
        parse_config(f"[taxels]\n{text}\n")


def test_a_session_keeps_its_layout(tmp_path: Path) -> None:
    layout = SensorLayout(6, 3, ("skin",))
    record(tmp_path / "s", layout)
    with Session.open(tmp_path / "s") as session:
        assert session.header.sensor_layout == session.sensor_layout == layout
    assert summarise_session(tmp_path / "s")["sensor_layout"]["layers"] == ["skin"]


def test_an_older_session_has_the_default_and_can_be_resumed(tmp_path: Path) -> None:
    record(tmp_path / "s", None)
    with Session.open(tmp_path / "s") as session:
        assert session.header.sensor_layout is None
        assert session.sensor_layout == PAPER
    record(tmp_path / "s", PAPER, resume=True)
    assert not [line for line in verify(tmp_path / "s").problems if "layout" in line]


def test_another_layout_cannot_resume_a_session(tmp_path: Path) -> None:
    record(tmp_path / "s", PAPER)
    with pytest.raises(SessionError, match=r"3 × 3 taxels in 2 layers \(I, II\), not 6 × 3"):
        record(tmp_path / "s", SensorLayout(6, 3, ("I",)), resume=True)
