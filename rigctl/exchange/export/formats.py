"""The formats of an export, and how one comes into being: whole, or not at all.

A format is an :class:`Exporter`: a name, what it needs besides rigctl, and a function that writes a
:class:`~rigctl.exchange.export.content.Content`. It writes beside the target under another name;
the last step gives it its name, so that a kill leaves nothing that looks like an export.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name
from typing import NamedTuple, Protocol

from rigctl.analysis.executors import Progress
from rigctl.analysis.files import atomic_directory, new_file
from rigctl.analysis.options import EncoderOptions
from rigctl.errors import DiskFault, WrongUse
from rigctl.exchange.export.content import Content, SpikeTrains
from rigctl.exchange.export.selection import Selection
from rigctl.exchange.export.spikes import spikes_of
from rigctl.plugins import Lookup
from rigctl.session.part import part_paths
from rigctl.session.session import open_session


class Write(Protocol):
    """Writes a session into a new file, or into an empty folder for a format without suffix."""

    def __call__(self, content: Content, spikes: SpikeTrains | None, target: Path) -> None:
        """Write all blocks of the content."""


@dataclass(frozen=True, slots=True)
class Exporter:
    """A format: what it is for people, and where its ``write`` is, as ``module:function``.

    ``suffix``: of its file; a format without one writes a folder. ``needs``: packages that must be
    there, of the extra ``rigctl[export]``. ``size``: bytes that it writes for one of the session at
    most, as far as was measured.
    """

    title: str
    suffix: str
    write: str
    size: float
    needs: tuple[str, ...] = ()

    def load(self) -> Write:
        """Return the function that writes. Raises WrongUse for a package that is not installed."""
        for package in self.needs:
            try:
                import_module(package)
            except ModuleNotFoundError as error:
                raise WrongUse(
                    f"{self.title} needs the package {error.name}: pip install 'rigctl[export]'"
                ) from error
        write: Write = resolve_name(self.write)
        return write


HERE = "rigctl.exchange.export"
EXPORTERS: Mapping[str, Exporter] = {
    "nwb": Exporter("NWB 2", ".nwb", f"{HERE}.nwb:write_nwb", 2.5, ("pynwb",)),
    "matlab": Exporter("MATLAB 7.3", ".mat", f"{HERE}.mat:write_mat", 2.5),
    "parquet": Exporter("Parquet", "", f"{HERE}.tables:write_parquet", 2.5, ("pyarrow",)),
    "neo": Exporter("Neo", ".nix", f"{HERE}.neo_blocks:write_nix", 6.0, ("neo", "nixio")),
    "csv": Exporter("CSV", "", f"{HERE}.tables:write_csv", 6.0, ("pyarrow",)),
}
"""Our formats by the name that the command line and the window use."""
FORMATS: Lookup[Exporter] = Lookup("exporter", EXPORTERS, Exporter)
"""Ours and those of other packages."""


class Exported(NamedTuple):
    """An export that is complete, and sentences on what it lacks."""

    target: Path
    remarks: tuple[str, ...]


def choose_targets(sessions: Sequence[Path], format_name: str, out: Path | None) -> list[Path]:
    """Return where the export of each session goes.

    ``out``: of one session the target itself; of several, the folder of all. Without it, an export
    stands beside its session. Raises WrongUse where a target exists, has another suffix than its
    format, or is that of two sessions; SessionError for a folder that is no session.
    """
    suffix = FORMATS.load(format_name).suffix
    for number, session in enumerate(sessions):
        if session.absolute() in [other.absolute() for other in sessions[:number]]:
            raise WrongUse(f"{session} is named twice: name each session once")
        part_paths(session)
    if out is not None and len(sessions) == 1:
        targets = [out]
    else:
        end = suffix or f"-{format_name}"
        places = [session.absolute() for session in sessions]
        targets = [(out or place.parent) / f"{place.name}{end}" for place in places]
    for number, (session, target) in enumerate(zip(sessions, targets, strict=True)):
        if target.suffix != suffix and suffix:
            raise WrongUse(f"{target} is no name of a {suffix} file: call it {target.name}{suffix}")
        if target.exists():
            raise WrongUse(f"{target} exists already: name another with --out, or remove it")
        if target in targets[:number]:
            name = session.absolute().name
            raise WrongUse(f"two sessions are called {name}: export them one by one")
        if any(target.absolute().is_relative_to(each.absolute()) for each in sessions):
            raise WrongUse(
                f"{target} is inside a session: a recording keeps to itself, choose --out"
            )
    return targets


def export_session(
    session: Path,
    format_name: str,
    target: Path,
    selection: Selection,
    options: EncoderOptions,
    progress: Progress = lambda stage, done, total: None,
) -> Exported:
    """Write a session, or a selection of it, into a new file or folder.

    Raises WrongUse for a target that exists, a package that is missing and a wrong choice,
    SessionError for what is no session, DiskFault where the target cannot be written. What
    ``progress`` raises ends the export, too. Nothing of it is left then.
    """
    exporter, plugin = FORMATS.load(format_name), FORMATS.plugin(format_name)
    write = exporter.load()
    _check_room(session, target, exporter)
    new = new_file if exporter.suffix else atomic_directory
    with open_session(session) as reader:
        content = Content(reader, selection, progress)
        with new(target) as place:
            spikes = spikes_of(content, options)
            with FORMATS.blamed(format_name):
                write(content, spikes, place)
    by = (f"written by the {plugin}",) if plugin else ()
    remarks = (*by, *content.remarks, *(spikes.remarks if spikes else ()))
    return Exported(target, tuple(dict.fromkeys(remarks)))


def _check_room(session: Path, target: Path, exporter: Exporter) -> None:
    """Raise DiskFault where an export may not fit: HDF5 does not survive a disk that gets full."""
    place = next(place for place in target.absolute().parents if place.exists())
    wanted = exporter.size * sum(path.stat().st_size for path in part_paths(session))
    free = shutil.disk_usage(place).free
    if wanted > free:
        raise DiskFault(
            f"{place} has {free / 1e6:,.0f} MB free, and {exporter.title} of {session} may need "
            f"{wanted / 1e6:,.0f} MB: free some space, choose another place, or fewer trials"
        )
