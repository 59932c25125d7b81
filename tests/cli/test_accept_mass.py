"""``rigctl accept`` weighs a known mass again and says how far the load cell has drifted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rigctl.cli import main
from tests.analysis.recordings import record

RIG = """\
[ports]
simulate = "virtual"
[loadcell]
scale_ug_per_count = {scale}
calibrated = "2026-01-02 with 200 g, 500 g"
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("accept") / "session", textures="A")


@pytest.mark.parametrize(("scale", "passes", "drift"), [(2400, True, 0.0), (2350, False, -2.08)])
def test_a_known_mass_shows_the_drift_of_the_cell(
    session: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    scale: int,
    passes: bool,
    drift: float,
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.format(scale=scale))
    main(("accept", str(session), "--rig", str(rig), "--mass", "200", "--json"))
    check = json.loads(capsys.readouterr().out)["checks"][-1]
    assert check["name"] == "load cell with a known mass" and check["passed"] is passes
    said = float(check["found"].partition("drifted by ")[2].partition(" %")[0])
    assert said == pytest.approx(drift, abs=0.15)
    assert check["found"].endswith("since 2026-01-02 with 200 g, 500 g")


def test_a_mass_without_a_rig_is_refused(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(("accept", str(session), "--mass", "200")) == 2
    assert "--rig and --mass belong together" in capsys.readouterr().err
