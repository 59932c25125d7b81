"""Sessions with their report as a bundle to cite: an RO-Crate with the checksum of every file.

A bundle is a folder: ``sessions/NAME`` with all files of each session, ``report`` with the figures,
``parameters.json`` with all that made them, and ``ro-crate-metadata.json``, which describes each
file and the software. :func:`verify_bundle` proves it, and :func:`remake` makes the report again
from what is in it and compares every figure.
"""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

from rigctl import __version__
from rigctl.analysis.cache import SERIAL_RESOURCES, Resources
from rigctl.analysis.files import atomic_directory
from rigctl.analysis.options import FINGER, AnalysisOptions, declared
from rigctl.config.resources import source_commit
from rigctl.config.text_file import open_file, refuse_link_outside
from rigctl.errors import SessionError, WrongUse
from rigctl.experiments import EXPERIMENTS, FINGER_EXPERIMENT
from rigctl.session.session import open_session
from rigctl.session.verify import VerifyReport, verify
from rigctl.session.writer_lock import LOCK_FILE, is_being_written

METADATA, PARAMETERS = "ro-crate-metadata.json", "parameters.json"
SESSIONS, REPORT, SETTINGS = "sessions", "report", "analysis.toml"
CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
PACKAGES = ("numpy", "scipy", "numba", "scikit-learn", "h5py", "vl-convert-python")
"""Packages whose versions may change a figure."""
FORMATS = {
    ".h5": "application/x-hdf5",
    ".toml": "application/toml",
    ".json": "application/json",
    ".csv": "text/csv",
    ".html": "text/html",
    ".svg": "image/svg+xml",
    ".png": "image/png",
}
FIGURES = (".svg", ".png")
NOT_IN_A_BUNDLE = ("c", "passport", "save_model", "representation", "components")
"""Options that read or write files which a bundle does not hold."""
OnProgress = Callable[[str, int, int], None]


class Citation(NamedTuple):
    """What a reader cites: title, people, and the licence as a URL or a name of SPDX."""

    title: str = ""
    creators: tuple[str, ...] = ()
    license: str = ""


def make_bundle(
    options: AnalysisOptions,
    out: Path,
    citation: Citation,
    made_utc: str,
    resources: Resources = SERIAL_RESOURCES,
) -> Path:
    """Write a bundle of the sessions and their report into a new folder.

    Raises WrongUse for sessions of one name and for options of files, SessionError for a session
    that is not whole or is being recorded, and as ``rigctl analyse`` does.
    """
    _check_options(options)
    reports = [_check_session(session) for session in options.sessions]
    if not any(report.trials_committed for report in reports):
        names = ", ".join(map(str, options.sessions))
        raise SessionError(f"there is no committed trial: {names}: a bundle has figures of trials")
    with atomic_directory(out) as folder:
        copies = tuple(_copy(session, folder / SESSIONS) for session in options.sessions)
        parameters = {
            "made_utc": made_utc,
            "sessions": [copy.name for copy in copies],
            "options": _chosen(options),
        }
        if options.settings is not None:
            shutil.copyfile(options.settings, folder / SETTINGS)
        _write_json(folder / PARAMETERS, parameters)
        _report(folder, parameters, folder / REPORT, resources)
        digests = [report.closing_digest for report in reports]
        graph = _describe(folder, parameters, citation, digests)
        _write_json(folder / METADATA, {"@context": CONTEXT, "@graph": graph})
    return out


def is_bundle(folder: Path) -> bool:
    """Return whether a folder is a bundle."""
    return (folder / METADATA).is_file()


def bundle_digest(folder: Path) -> str:
    """Return the SHA-256 of a bundle's description, which has those of all its files."""
    return _sha256(folder / METADATA)


def verify_bundle(
    folder: Path, on_progress: OnProgress = lambda stage, done, total: None
) -> list[str]:
    """Return a line for each thing that is not as a bundle's description says; empty for none.

    Every file is compared with its checksum, and each session is checked as ``rigctl verify`` does.
    Raises SessionError where there is no description that can be read.
    """
    listed = {unquote(str(each["@id"])): each for each in _graph(folder) if each["@type"] == "File"}
    found = {path.relative_to(folder).as_posix() for path in _files(folder)} - {METADATA}
    problems = [f"{name}: is missing" for name in sorted(listed.keys() - found)]
    problems += [f"{name}: is not in {METADATA}" for name in sorted(found - listed.keys())]
    both = sorted(found & listed.keys())
    for done, name in enumerate(both):
        on_progress("checking files", done, len(both))
        if _sha256(folder / name) != listed[name].get("sha256"):
            problems.append(f"{name}: is not what was bundled")
    on_progress("checking files", len(both), max(1, len(both)))
    for session in _parameters(folder)["sessions"]:
        report = verify(folder / SESSIONS / session)
        problems += [f"{SESSIONS}/{session}: {problem}" for problem in report.problems]
    return problems


class Remade(NamedTuple):
    """A report that was made again: how many figures are equal, and which are not."""

    folder: Path
    equal: tuple[str, ...]
    different: tuple[str, ...]


def remake(folder: Path, out: Path, resources: Resources = SERIAL_RESOURCES) -> Remade:
    """Make the report of a bundle again, in a new folder, and compare every figure.

    Raises as :func:`make_bundle`, and SessionError for a folder that is no bundle.
    """
    _graph(folder)
    _report(folder, _parameters(folder), out, resources)
    figures = [path.name for path in _files(folder / REPORT) if path.suffix in FIGURES]
    made = {name: _is_equal(folder / REPORT / name, out / name) for name in figures}
    return Remade(
        out,
        tuple(name for name in figures if made[name]),
        tuple(name for name in figures if not made[name]),
    )


def _is_equal(one: Path, other: Path) -> bool:
    return other.is_file() and one.read_bytes() == other.read_bytes()


def _check_options(options: AnalysisOptions) -> None:
    _ = options.analysis  # the settings' file can be read
    defaults = declared(AnalysisOptions)
    for name in NOT_IN_A_BUNDLE:
        if getattr(options, name) != defaults[name].default:
            raise WrongUse(
                f"--{name.replace('_', '-')} needs a file that no bundle has: leave it out"
            )
    if options.ranges not in ("all", "training"):
        raise WrongUse("--ranges FILE needs a file that no bundle has: give all or training")
    names = [session.absolute().name for session in options.sessions]
    if len(set(names)) < len(names):
        raise WrongUse("two sessions have the same name: give one of their folders another")


def _check_session(session: Path) -> VerifyReport:
    """Verify a session. Raises SessionError for one that is not whole and closed."""
    if is_being_written(session):
        raise SessionError(f"{session} is still being recorded: bundle it when it is finished")
    report = verify(session)
    if not report.whole:
        raise SessionError(f"{session} is not whole ({report.problems[0]}): it is nothing to cite")
    return report


def _copy(session: Path, place: Path) -> Path:
    for path in _files(session):
        refuse_link_outside(path, SessionError)
    copy = place / session.absolute().name
    shutil.copytree(session, copy, ignore=shutil.ignore_patterns(LOCK_FILE))
    return copy


def _chosen(options: AnalysisOptions) -> dict[str, Any]:
    """Return the options that differ from the defaults, as JSON has them."""
    values = {
        name: getattr(options, name)
        for name, one in declared(AnalysisOptions).items()
        if name != "settings" and getattr(options, name) != one.default
    }
    return {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}


def _report(folder: Path, parameters: Mapping[str, Any], out: Path, resources: Resources) -> None:
    """Make the report of a bundle's sessions."""
    chosen: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in parameters["options"].items()
    }
    sessions = tuple(folder / SESSIONS / name for name in parameters["sessions"])
    options = AnalysisOptions(**{**chosen, "sessions": sessions, "out": out})
    if (folder / SETTINGS).exists():
        options = replace(options, settings=folder / SETTINGS)
    with open_session(sessions[0]) as reader:
        experiment = reader.layout.experiment
    if experiment == FINGER_EXPERIMENT:
        options = replace(options, experiment=FINGER)
        EXPERIMENTS[experiment].load("report")(options, parameters["made_utc"], resources)
        return
    from rigctl.analysis.report.report_folder import make_report

    make_report(options, parameters["made_utc"], resources)


def _describe(
    folder: Path, parameters: Mapping[str, Any], citation: Citation, digests: Sequence[str]
) -> list[dict[str, Any]]:
    """Return the entities of the description: the bundle, its files, software and parameters."""
    files = [_describe_file(folder, path) for path in _files(folder)]
    sessions = [
        {
            "@id": f"{SESSIONS}/{quote(name)}/",
            "@type": "Dataset",
            "name": name,
            "identifier": digest,
            "description": _describe_session(folder / SESSIONS / name),
        }
        for name, digest in zip(parameters["sessions"], digests, strict=True)
    ]
    software = [
        {"@id": f"#{name}", "@type": "SoftwareApplication", "name": name, "version": number}
        for name, number in _software().items()
    ]
    values = [
        {"@id": f"#option-{n}", "@type": "PropertyValue", "name": n, "value": json.dumps(v)}
        for n, v in parameters["options"].items()
    ]
    people = [{"@id": f"#{quote(n)}", "@type": "Person", "name": n} for n in citation.creators]
    results = [each["@id"] for each in files if each["@id"].startswith(f"{REPORT}/")]
    action = {
        "@id": "#analysis",
        "@type": "CreateAction",
        "name": "rigctl analyse",
        "endTime": parameters["made_utc"],
        "instrument": {"@id": "#rigctl"},
        "object": _references([each["@id"] for each in (*sessions, *values)]),
        "result": _references(results),
    }
    is_simulated = any("SIMULATED" in each["description"] for each in sessions)
    origin = "SIMULATED data: " if is_simulated else ""
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": citation.title or ", ".join(parameters["sessions"]),
        "description": f"{origin}tactile recordings of rigctl with the figures that they give; "
        "`rigctl verify` proves the bundle, `rigctl bundle --remake` makes every figure again",
        "datePublished": parameters["made_utc"],
        "license": citation.license or "no licence was given",
        "hasPart": _references([each["@id"] for each in (*sessions, *files)]),
        "mentions": {"@id": "#analysis"},
        **({"creator": _references([each["@id"] for each in people])} if people else {}),
    }
    about = {
        "@id": METADATA,
        "@type": "CreativeWork",
        "about": {"@id": "./"},
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
    }
    return [about, root, *sessions, *files, *software, *values, *people, action]


def _references(ids: Sequence[str]) -> list[dict[str, str]]:
    return [{"@id": one} for one in ids]


def _describe_file(folder: Path, path: Path) -> dict[str, Any]:
    name = path.relative_to(folder).as_posix()
    return {
        "@id": quote(name),
        "@type": "File",
        "name": path.name,
        "contentSize": str(path.stat().st_size),
        "encodingFormat": FORMATS.get(path.suffix, "application/octet-stream"),
        "sha256": _sha256(path),
    }


def _describe_session(session: Path) -> str:
    with open_session(session) as reader:
        header = reader.header
        origin = "SIMULATED data: " if header.simulated else ""
        n = len(reader.committed())
        return (
            f"{origin}protocol {header.protocol}, rig {header.rig}, {n} trials, {header.start_utc}"
        )


def _software() -> dict[str, str]:
    own = f"{__version__} {source_commit()}".strip()
    return {
        "rigctl": own,
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
    }


def _graph(folder: Path) -> list[dict[str, Any]]:
    try:
        with open_file(folder / METADATA, SessionError) as file:
            graph = json.load(file)["@graph"]
        if not all(isinstance(each["@id"], str) and "@type" in each for each in graph):
            raise ValueError("an entity has no @id or @type")
    except (ValueError, KeyError, TypeError) as error:
        raise SessionError(f"{folder / METADATA} is no description of a bundle: {error}") from error
    return list(graph)


def _parameters(folder: Path) -> Mapping[str, Any]:
    """Return the parameters of a bundle. Raises SessionError for a file that has none."""
    try:
        with open_file(folder / PARAMETERS, SessionError) as file:
            found = json.load(file)
        names, options = found["sessions"], found["options"]
        unknown = options.keys() - declared(AnalysisOptions).keys()
        if unknown or not names or not all(Path(name).name == name for name in names):
            raise ValueError("it names sessions or options that there are not")
        return {"made_utc": str(found["made_utc"]), "sessions": names, "options": options}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SessionError(f"{folder / PARAMETERS} cannot be used: {error}") from error


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _sha256(path: Path) -> str:
    with open_file(path, SessionError) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _write_json(path: Path, value: Any) -> None:
    path.write_text(f"{json.dumps(value, indent=1, ensure_ascii=False)}\n", encoding="utf-8")
