"""A part from a stranger is opened as declared, or refused in one sentence."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from threading import Thread
from typing import Any

import h5py
import numpy as np
import pytest

from rigctl.errors import SessionError
from rigctl.finger.layout import FINGER_LAYOUT
from rigctl.finger.session import FingerSession
from rigctl.session.hdf5_file import write_attributes
from rigctl.session.layout import DRUM_LAYOUT, LIBVER, TEXTS, SessionLayout
from rigctl.session.part import PartReader
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.finger import finger_building
from tests.session import building
from tests.session.hostile.spoiling import HOSTILE, spoil

LAYOUTS = {"drum": DRUM_LAYOUT, "finger": FINGER_LAYOUT}
WRONG_ATTRIBUTES: dict[str, tuple[Any, ...]] = {
    "sample_rate_hz": (0, -1, np.nan, 1e9, "1000", [1000, 1000]),
    "n_taxels": (0, 17, 1 << 40, "18", np.inf),
    "boards": ("{}", "[1]", "[" * 100_000, '[{"board": 1}]', "no JSON", 5),
    "simulation": ("[]", "{", '{"seed": 1' + "0" * 5_000 + "}"),
    "taxel_low": ("[1]", "[NaN]", '["a"]', "[70000]", "{}"),
    "wiring": ("[1]", "[-1]", "[[]]"),
    "sensor_layout": (
        5,
        "[]",
        "{",
        "{}",
        '{"rows": 3, "columns": 3, "layers": "I"}',
        '{"rows": 1.0, "columns": 1, "layers": ["I"]}',
        '{"rows": 9, "columns": 9, "layers": ["I"]}',
        '{"rows": -9, "columns": -2, "layers": ["I"]}',
        '{"rows": 0, "columns": 3, "layers": ["I"]}',
        '{"rows": 3, "columns": 3, "layers": ["I", "I"]}',
        '{"rows": 3, "columns": 3, "layers": ["I", ""]}',
        '{"rows": 3, "columns": 3, "layers": ["I", "\\u001b[2J"]}',
        '{"rows": 99999999999999999999, "columns": 99999999999999999999, "layers": ["I"]}',
    ),
    "plan_hash": (5, [b"a", b"b"]),
    "seed": (0.5, "1"),
    "simulated": (7, "yes"),
    "start_loop_s": (np.nan, "0"),
    "highest_reading": (0, 1 << 20),
    "experiment": (3, [b"drum"], "another"),
    "layout": (1, "rigctl-spikes"),
    "layout_version": (2, "1"),
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    building.record_plan(folder / "drum")
    finger_building.record_plan(folder / "finger")
    return folder


@pytest.fixture
def sessions(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "sessions"))


def refusal(part: Path) -> str:
    """Return the sentence that refuses a part."""
    with pytest.raises(SessionError) as caught:
        PartReader(part).close()
    sentence = str(caught.value)
    assert str(part) in sentence
    assert "\n" not in sentence
    return sentence


def data_sets(layout: SessionLayout) -> list[str]:
    return [each.path for each in (*layout.arrays, *layout.tables)] + [path for path, _ in TEXTS]


@pytest.mark.parametrize("experiment", LAYOUTS)
@pytest.mark.parametrize("change", HOSTILE)
def test_each_hostile_data_set_is_refused_by_its_path(
    sessions: Path, experiment: str, change: str
) -> None:
    part = sessions / experiment / "part-0001.h5"
    whole = part.read_bytes()
    for path in data_sets(LAYOUTS[experiment]):
        spoil(part, path, HOSTILE[change])
        assert path in refusal(part)
        part.write_bytes(whole)
    PartReader(part).close()


def test_a_text_in_another_file_is_not_read(sessions: Path) -> None:
    for number in (1, 2):
        part = sessions / "drum" / f"part-{number:04d}.h5"
        spoil(part, "/protocol_toml", HOSTILE["external storage"])
        with h5py.File(part) as plain:
            assert b"secret" in plain["/protocol_toml"][()]
    with pytest.raises(SessionError, match="/protocol_toml is stored outside the file"):
        Session.open(sessions / "drum")
    assert any("outside the file" in line for line in verify(sessions / "drum").problems)


def test_a_link_to_a_group_elsewhere_is_not_followed(sessions: Path) -> None:
    part = sessions / "drum" / "part-0001.h5"
    shutil.copy(part, part.with_name("other.h5"))
    with h5py.File(part, "r+", libver=LIBVER) as file:
        del file["taxels"]
        file["taxels"] = h5py.ExternalLink("other.h5", "/taxels")
    assert "/taxels is a link" in refusal(part)


@pytest.mark.parametrize("name", WRONG_ATTRIBUTES)
def test_each_wrong_attribute_is_refused(sessions: Path, name: str) -> None:
    part = sessions / "drum" / "part-0001.h5"
    whole = part.read_bytes()
    for value in WRONG_ATTRIBUTES[name]:
        with h5py.File(part, "r+", libver=LIBVER) as file:
            file.attrs.pop(name, None)
            if isinstance(value, str | int | float):
                write_attributes(file, {name: value})
            else:
                file.attrs[name] = value
        assert len(refusal(part)) < 400, value
        part.write_bytes(whole)


@pytest.mark.parametrize(
    "name", ["layout", "layout_version", "plan_hash", "seed", "trials_planned", "rig", "boards"]
)
def test_a_removed_attribute_is_named(sessions: Path, name: str) -> None:
    part = sessions / "drum" / "part-0001.h5"
    with h5py.File(part, "r+", libver=LIBVER) as file:
        del file.attrs[name]
    words = "not a part" if name == "layout" else "has layout version" if "layout" in name else name
    assert words in refusal(part)


@pytest.mark.parametrize("value", [h5py.Empty("i4"), np.zeros((2, 2)), np.zeros(1 << 18)])
def test_an_attribute_of_another_kind_is_refused(sessions: Path, value: Any) -> None:
    part = sessions / "drum" / "part-0001.h5"
    with h5py.File(part, "r+", libver=LIBVER) as file:
        file.attrs["operator"] = value
    assert "operator" in refusal(part)


def test_a_refused_attribute_keeps_no_other_thread_from_reading(sessions: Path) -> None:
    """h5py's views of attributes hold its lock until their end; a recorder waited for ever."""
    part = sessions / "drum" / "part-0001.h5"
    with h5py.File(part, "r+", libver=LIBVER) as file:
        file.attrs["operator"] = np.zeros((2, 2))
    with pytest.raises(SessionError) as refused:
        PartReader(part).close()
    reader = Thread(target=lambda: h5py.File(part, "r").close(), daemon=True)
    reader.start()
    reader.join(10)
    assert "operator" in str(refused.value) and not reader.is_alive()


def test_names_of_attributes_are_shown_short_and_without_control_characters(
    sessions: Path,
) -> None:
    part = sessions / "drum" / "part-0001.h5"
    whole = part.read_bytes()
    for name in ("x" * 5_000, "\x1b[2J\u202e\n"):
        with h5py.File(part, "r+", libver=LIBVER) as file:
            file.attrs[name] = np.zeros((2, 2))
        sentence = refusal(part)
        assert len(sentence) < 400
        assert sentence.isprintable()
        part.write_bytes(whole)


def test_a_file_without_a_readable_root_is_closed_again(sessions: Path) -> None:
    part = sessions / "drum" / "part-0001.h5"
    content = bytearray(part.read_bytes())
    content[48:96] = bytes(48)
    part.write_bytes(content)
    refusal(part)
    assert not h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE)


def test_a_session_that_is_refused_leaves_no_file_open(
    sessions: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise SessionError("rows that no reader can join")

    monkeypatch.setattr(Session, "_load", refuse)
    with pytest.raises(SessionError, match="no reader can join"):
        Session.open(sessions / "drum")
    assert not h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE)


def test_text_that_is_not_utf8_is_refused_where_it_is_read(sessions: Path) -> None:
    part = sessions / "finger" / "part-0001.h5"
    with h5py.File(part, "r+", libver=LIBVER) as file:
        dtype = file["/protocol_toml"].dtype
        file["/protocol_toml"][()] = np.array(b"\xff" * dtype.itemsize, dtype)
    with FingerSession.open(sessions / "finger") as session:
        with pytest.raises(SessionError, match="/protocol_toml: 'utf-8' codec"):
            assert session.protocol_text
        assert session.rig_text


def test_what_is_no_file_is_refused_without_being_opened(tmp_path: Path) -> None:
    folder, pipe = tmp_path / "part-0001.h5", tmp_path / "part-0002.h5"
    folder.mkdir()
    os.mkfifo(pipe)
    assert "is a folder" in refusal(folder)
    assert "is a pipe" in refusal(pipe)
    assert "is a device" in refusal(Path("/dev/zero"))
    assert "No such file" in refusal(tmp_path / "part-0003.h5")
    for name, words in (("part-" + "9" * 300, "too long"), ("part-\0", "no zero byte")):
        with pytest.raises(SessionError, match=words):
            PartReader(tmp_path / name)
    (tmp_path / "part-0004.h5").write_bytes(b"")
    assert "is damaged" in refusal(tmp_path / "part-0004.h5")


def test_boards_of_older_parts_without_details_are_read(sessions: Path) -> None:
    part = sessions / "drum" / "part-0001.h5"
    with h5py.File(part, "r+", libver=LIBVER) as file:
        boards = json.loads(file.attrs["boards"])
        for board in boards:
            del board["details"]
        write_attributes(file, {"boards": json.dumps(boards)})
    reader = PartReader(part)
    assert reader.header.boards[0].details == {}
    reader.close()


def test_data_of_events_and_answers_that_are_not_json_name_part_and_place(sessions: Path) -> None:
    for experiment, table, column in (
        ("drum", "/events", "data"),
        ("finger", "/events", "data"),
        ("finger", "/predictions", "probabilities"),
    ):
        with h5py.File(sessions / experiment / "part-0002.h5", "r+", libver=LIBVER) as file:
            row = file[table][0]
            row[column] = b"{{"
            file[table][0] = row
    with (
        Session.open(sessions / "drum") as drum,
        pytest.raises(SessionError, match=r"part-0002\.h5 is damaged: the event at .* is not JSON"),
    ):
        assert drum.events
    with FingerSession.open(sessions / "finger") as finger:
        indices = range(len(finger.trials))
        with pytest.raises(SessionError, match=r"the answer at .* in /predictions is not JSON"):
            assert [finger.predictions(index) for index in indices]


def test_counters_outside_a_scan_are_refused(sessions: Path) -> None:
    with h5py.File(sessions / "finger" / "part-0001.h5", "r+", libver=LIBVER) as file:
        first = int(file["/trials"][0]["first_sample"])
        file["/taxels/counter"][first + 5] += 1 << 40
    with (
        FingerSession.open(sessions / "finger") as finger,
        pytest.raises(SessionError, match="has samples outside its scan"),
    ):
        finger.scan_spikes(0)
