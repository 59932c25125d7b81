"""Worked example: a register that is polled, stored and shown is two files, and two generated ones.

The potentiometer's own reading comes with every poll: as a column of a session and a cell of the
window.
"""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from rigctl.boards.drum_registers import POLL, POLL_BLOCK
from rigctl.errors import SessionError
from rigctl.session import layout
from rigctl.session.hdf5_file import DataSetSchema, Hdf5File
from tests.architecture.imports import CHECKOUT
from tests.architecture.lab_copy import changed_files, copy_program, run_in

EDITS = {
    "rigctl/boards/drum_registers.py": {
        "MAP_VERSION = 5\n": "MAP_VERSION = 6\n",
        """    Register(55, "last_contact_um", "actuator travel at the last contact", "µm"),
""": """    Register(55, "last_contact_um", "actuator travel at the last contact", "µm"),
    Register(56, "wiper", "the potentiometer's reading", "counts", shown="Wiper", stored=True),
""",
    },
    "arduino/drum/report.cpp": {
        "    bank_.put(reg::last_contact_um,": (
            "    bank_.put(reg::wiper, controller_.signals().position_raw());\n"
            "    bank_.put(reg::last_contact_um,"
        )
    },
}
GENERATED = {"arduino/drum/drum_map.h", "docs/reference/drum-wire.md"}
RECORD = """
import json, sys
from pathlib import Path
from PySide6.QtWidgets import QApplication
from gui.live.health import HealthStrip
from rigctl.errors import SessionError
from rigctl.session import layout
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.engine.engine_harness import open_harness

folder = Path(sys.argv[1])
with open_harness(folder) as harness:
    harness.record('name = "one"\\ntextures = ["A"]\\nspeeds_mm_s = [100]\\nforces_g = [500]\\n')
    status = harness.engine.status()
app = QApplication([])
strip = HealthStrip()
strip.show_status(status)
assert verify(harness.session).whole
with Session.open(harness.session) as session:
    polls = session.parts[0].rows(layout.DRUM)
print(json.dumps({
    "status": status.registers,
    "cell": strip.cells["wiper"].value.text(),
    "stored": polls["wiper"].tolist(),
    "position": polls["actuator_position_um"].tolist(),
}))
"""


def test_a_register_is_polled_stored_and_shown(tmp_path: Path) -> None:
    copy = copy_program(tmp_path, EDITS)
    run_in(copy, "-m", "rigctl.boards.codegen")
    assert changed_files(copy) == {*EDITS, *GENERATED}
    run_in(copy, "-m", "rigctl.host_build")
    seen = json.loads(run_in(copy, "-c", RECORD, str(tmp_path)))
    wiper, position = np.array(seen["stored"]), np.array(seen["position"])
    assert seen["status"] == {"wiper": pytest.approx(wiper[-1], abs=5)}
    assert seen["cell"] == f"{seen['status']['wiper']:g} counts"
    assert np.ptp(wiper) > 50 and np.corrcoef(wiper, position)[0, 1] > 0.99
    page = (copy / "docs/reference/drum-wire.md").read_text(encoding="utf-8")
    assert "shown as *Wiper*; column `wiper` of `/drum`" in page


def test_a_file_of_before_lacks_the_column(tmp_path: Path) -> None:
    dtype = np.dtype([("at_s", "<f8"), ("wiper", "<f4")])
    path = tmp_path / "part.h5"
    with h5py.File(path, "w") as file:
        file["drum"] = np.zeros(3, [("at_s", "<f8")])
        file["other"] = np.zeros(3, [("at_s", "<f4")])
    with Hdf5File(path) as file:
        file.check([DataSetSchema("/drum", 1, dtype=dtype, tail=(), optional=frozenset({"wiper"}))])
        for name, optional in (("/drum", frozenset[str]()), ("/other", frozenset({"wiper"}))):
            with pytest.raises(SessionError, match="is not"):
                file.check([DataSetSchema(name, 1, dtype=dtype, tail=(), optional=optional)])


def test_polls_are_one_read_without_a_gap_between_registers() -> None:
    assert (POLL[0].address, sum(entry.words * entry.count for entry in POLL)) == POLL_BLOCK


def test_the_page_lists_the_files() -> None:
    text = (CHECKOUT / "docs/explanation/architecture.md").read_text(encoding="utf-8")
    (row,) = (line for line in text.splitlines() if line.startswith("| a register of the drum"))
    for name in (*EDITS, "make docs", "`shown`", "`stored`"):
        assert name in row, name
    assert not [column.name for column in layout.DRUM.columns if column.optional]
