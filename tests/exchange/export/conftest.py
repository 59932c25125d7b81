"""Sessions of both experiments, and how a test exports one."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

from rigctl.analysis.options import EncoderOptions
from rigctl.exchange.export.formats import EXPORTERS, Exported, export_session
from rigctl.exchange.export.selection import Representation, Selection
from tests.session.conftest import drum, finger

__all__ = ["drum", "finger"]
INSTALLED = [to for to in EXPORTERS if to != "neo" or find_spec("nixio")]
needs_nix = pytest.mark.skipif(
    "neo" not in INSTALLED, reason="nixio has no wheel: make exchange installs it and runs this"
)
EVERYTHING = Selection(representations=tuple(Representation))


def export(session: Path, to: str, target: Path, selection: Selection = EVERYTHING) -> Exported:
    """Export a session without a command line."""
    return export_session(session, to, target, selection, EncoderOptions((session,)))


@pytest.fixture(scope="session")
def nwb(drum: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The session of the drum as NWB."""
    return export(drum, "nwb", tmp_path_factory.mktemp("nwb") / "drum.nwb").target
