"""A session stores the reading at each place, and a rig with another order cannot resume it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.config.rig_config import RigConfig, TaxelArray
from rigctl.errors import SessionError
from rigctl.session.header import IMPORTED, SessionHeader, session_wiring, source_wiring
from rigctl.session.recorder import Recorder
from rigctl.session.session import Session
from rigctl.session.verify import verify
from rigctl.values import DRAWN_WIRING
from tests.session.building import PROTOCOL, RIG, SyntheticRig, header, plan

AS_WIRED = tuple(range(18))
BACKWARDS = tuple(reversed(range(18)))


def with_wiring(wiring: tuple[int, ...]) -> SessionHeader:
    return replace(header(), wiring=wiring)


def record(folder: Path, head: SessionHeader, rig: str = RIG, *, resume: bool = False) -> None:
    with Recorder(folder, head, PROTOCOL, rig, resume=resume) as recorder:
        recorder.begin_part("resume" if resume else "start", "A")
        SyntheticRig(recorder).trial(plan().trials[0])


def test_a_session_records_its_wiring(tmp_path: Path) -> None:
    record(tmp_path / "s", with_wiring(DRAWN_WIRING))
    with Session.open(tmp_path / "s") as session:
        assert session.wiring == session.header.wiring == DRAWN_WIRING


def test_a_stored_rig_description_names_the_order_explicitly() -> None:
    assert RigConfig().with_order().taxels.wiring == DRAWN_WIRING
    assert f"wiring = {list(DRAWN_WIRING)}" in RigConfig().with_order().to_toml()
    own = RigConfig(taxels=TaxelArray(wiring=BACKWARDS))
    assert own.with_order() == own
    assert TaxelArray(count=4).order == (0, 1, 2, 3)


def test_an_older_part_has_the_order_of_the_wire_unless_its_rig_names_another() -> None:
    assert session_wiring(header(), RIG) == AS_WIRED
    assert session_wiring(header(), f"[taxels]\nwiring = {list(BACKWARDS)}\n") == BACKWARDS
    assert session_wiring(replace(header(), rig=IMPORTED), RIG) == ()
    with pytest.raises(SessionError, match="description of its rig: this is not TOML"):
        session_wiring(header(), "[taxels")


def test_an_older_model_has_the_order_of_the_wire() -> None:
    assert source_wiring({"rig": "bench", "n_taxels": 18}) == AS_WIRED
    assert source_wiring({"rig": IMPORTED, "n_taxels": 18}) == ()
    assert source_wiring({"wiring": list(DRAWN_WIRING), "n_taxels": 18}) == DRAWN_WIRING


@pytest.mark.parametrize("begun", [(), DRAWN_WIRING])
def test_a_session_is_not_continued_with_another_order(
    tmp_path: Path, begun: tuple[int, ...]
) -> None:
    record(tmp_path / "s", with_wiring(begun))
    before = {path.name: path.read_bytes() for path in (tmp_path / "s").iterdir()}
    with pytest.raises(SessionError, match="taxels in another order") as caught:
        record(tmp_path / "s", with_wiring(BACKWARDS), resume=True)
    assert f"wiring = {list(begun or AS_WIRED)}, not {list(BACKWARDS)}" in str(caught.value)
    assert {path.name: path.read_bytes() for path in (tmp_path / "s").iterdir()} == before


def test_an_older_session_is_continued_by_a_rig_that_names_its_order(tmp_path: Path) -> None:
    record(tmp_path / "s", with_wiring(()))
    record(
        tmp_path / "s", with_wiring(AS_WIRED), f"[taxels]\nwiring = {list(AS_WIRED)}\n", resume=True
    )
    with Session.open(tmp_path / "s") as session:
        assert session.wiring == AS_WIRED
    assert not [line for line in verify(tmp_path / "s").problems if "order" in line]


def test_verify_reports_a_part_with_another_order(tmp_path: Path) -> None:
    record(tmp_path / "s", with_wiring(DRAWN_WIRING))
    record(tmp_path / "other", with_wiring(BACKWARDS))
    record(tmp_path / "other", with_wiring(BACKWARDS), resume=True)
    (tmp_path / "other" / "part-0002.h5").rename(tmp_path / "s" / "part-0002.h5")
    found = verify(tmp_path / "s").problems
    assert "part-0002.h5: has its taxels in another order than the first" in found


@pytest.mark.parametrize(
    "rig_text",
    [
        "x = ",
        "a" + ".a" * 100_000 + " = 1",
        "[" * 10_000,
        "taxels = 1",
        "[taxels]\nwiring = 5\n",
        "[taxels]\nwiring = [1.5, nan]\n",
        f"[taxels]\nwiring = [{10**400}]\n",
    ],
)
def test_a_damaged_description_of_the_rig_is_refused(rig_text: str) -> None:
    with pytest.raises(SessionError, match=r"^the session's description of its rig"):
        session_wiring(with_wiring(()), rig_text)
