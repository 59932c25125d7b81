"""Bad input: handled with a remark in the report, or refused with the names of file and trial.

``docs/reference/analysis.md`` has the table; each of its rows has a test here.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

from rigctl.analysis.representations import RepresentationSet, represent
from rigctl.analysis.result_tables import as_dict
from rigctl.analysis.tasks import SweepSettings, run_tasks
from rigctl.analysis.trial_set import TrialSet, join_sessions, open_trials
from rigctl.cli import main
from rigctl.encoder.parameters import DEFAULT
from rigctl.errors import SessionError, WrongUse
from rigctl.session.part import part_paths
from tests.analysis.recordings import record
from tests.session.building import SyntheticRig, plan, recorder
from tests.session.damage import record_four_parts
from tests.session.forging import rewrite_digests

FEW = SweepSettings(iterations=2, k_max=8)
UTC = "2026-11-21T12:00:00Z"
NO_NUMBER = re.compile(r"(?<![a-z])-?(nan|inf|infinity)(?![a-z])", re.IGNORECASE)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bad") / "good"
    return record(folder, "ABG", repeats=2, travel_mm=12.0, speeds=(40, 80))


@pytest.fixture
def session(good: Path, tmp_path: Path) -> Path:
    """Return a copy that a test may damage."""
    return Path(shutil.copytree(good, tmp_path / "session"))


def damage(session: Path, change: Callable[[Any], None]) -> None:
    for part in part_paths(session):
        with h5py.File(part, "r+") as file:
            change(file)
    rewrite_digests(session)


def _set_attribute(name: str, value: int, file: Any) -> None:
    file.attrs[name] = value


def analyse(session: Path, folder: Path) -> tuple[RepresentationSet, dict[str, Any]]:
    """Return the numbers of a report without figures, which JSON takes only if all are finite."""
    features = folder / "features"
    features.mkdir()
    made = represent(join_sessions([session]), DEFAULT, features)
    results, remarks = run_tasks(made, FEW)
    plain = as_dict(made, FEW, results, (*made.remarks, *remarks), UTC)
    json.dumps(plain, allow_nan=False)
    for representation in made.present:
        assert np.isfinite(made.features(representation)).all()
    return made, plain


def remarks_of(plain: dict[str, Any]) -> str:
    return "\n".join(plain["remarks"])


def test_trials_with_gaps_and_aborted_ones_are_left_out_and_named(
    session: Path, tmp_path: Path
) -> None:
    def abort_and_tear(file: Any) -> None:
        rows = file["/trials"][:]
        rows["verdict"][0] = b"aborted"
        rows["verdict"][1] = b"rejected"
        rows["first_sample"][3] = -1
        rows["first_counter"][3:] += 7  # seven samples are lost in the third trial
        file["/trials"][:] = rows
        counter = file["/taxels/counter"][:]
        counter[rows["first_sample"][2] + 10 :] += 7
        file["/taxels/counter"][:] = counter

    damage(session, abort_and_tear)
    made, plain = analyse(session, tmp_path)
    assert len(made.trials.trials) == 24 - 4
    assert f"{session}: attempts left out: 1 aborted, 1 rejected" in remarks_of(plain)
    assert "2 trials left out for gaps in their samples: 3, 4" in remarks_of(plain)


def test_a_session_without_a_complete_trial_is_refused(session: Path, tmp_path: Path) -> None:
    def tear(file: Any) -> None:
        rows = file["/trials"][:]
        rows["first_sample"] = -1
        file["/trials"][:] = rows

    damage(session, tear)
    with pytest.raises(SessionError, match=f"{session}: 24 trials .* no complete trial is left"):
        represent(join_sessions([session]), DEFAULT, tmp_path)


def test_other_taxels_layouts_and_rates_are_refused(good: Path, tmp_path: Path) -> None:
    other = tmp_path / "narrow"
    np.save(tmp_path / "A_1.npy", np.arange(180).reshape(60, 3))
    (tmp_path / "map.toml").write_text(
        "[files]\npattern = '(?P<texture>[A-Z])_'\n[labels]\nspeed_mm_s = 40\n"
        '[time]\nrate_hz = 1000\n[taxels]\ncolumns = ["1..3"]\n'
    )
    words = ["import", "--map", str(tmp_path / "map.toml"), str(tmp_path / "A_1.npy")]
    assert main([*words, "--out", str(other)]) == 0
    with pytest.raises(SessionError, match=f"{other} has 3 taxels, {good} has 18"):
        join_sessions([good, other])
    for name, value, message in (
        ("layout_version", 2, "part-0001.h5 has layout version 2, this program reads 1"),
        ("sample_rate_hz", 500, "500 samples a second, not 1000: resample it first"),
    ):
        copy = Path(shutil.copytree(good, tmp_path / name))
        damage(copy, partial(_set_attribute, name, value))
        with pytest.raises(SessionError, match=message):
            join_sessions([copy])
        with pytest.raises(SessionError, match=str(copy)):
            join_sessions([good, copy])


def abort(force_g: int, file: Any) -> None:
    rows = file["/trials"][:]
    some = (rows["texture"] == b"B") & (rows["force_g"] == force_g) & (rows["speed_mm_s"] == 80)
    rows["verdict"][some] = b"aborted"
    file["/trials"][:] = rows


def test_a_missing_force_costs_no_trial_where_the_reference_is(
    session: Path, tmp_path: Path
) -> None:
    damage(session, partial(abort, 250))
    made, plain = analyse(session, tmp_path)
    assert len(made.present) == 8 and len(made.trials.trials) == 24 - 2
    assert made.force is not None and made.force.absent_conditions == [("B", 80.0, 250.0)]
    assert "C has no entry for combinations" in remarks_of(plain)
    assert "1 (B at 80 mm/s and 250 g)" in remarks_of(plain)
    others = [made.force.c_at(texture, 80.0, 250.0) for texture in "AG"]
    blind = made.force.texture_blind(80.0, 250.0)
    np.testing.assert_allclose(blind, np.mean(others, axis=0))
    with pytest.raises(WrongUse, match="no entry for texture B, 80 mm/s and 250 g"):
        made.force.c_at("B", 80.0, 250.0)


def test_a_texture_and_speed_without_the_reference_is_left_out_alone(
    session: Path, tmp_path: Path
) -> None:
    damage(session, partial(abort, 500))
    made, plain = analyse(session, tmp_path)
    assert len(made.present) == 8 and len(made.trials.trials) == 24 - 4
    assert "have no C: 2; their texture and speed have no trial at the" in remarks_of(plain)
    assert "of 500 g: texture B at 80 mm/s" in remarks_of(plain)
    assert {t.speed_mm_s for t in made.trials.trials if t.texture == "B"} == {40.0}
    words = ["encode", str(session), "--no-cache", "--out"]
    assert main([*words, str(tmp_path / "plain")]) == 0
    assert main([*words, str(tmp_path / "scaled"), "--scaled-by", "blind"]) == 0
    counts = []
    for name in ("plain", "scaled"):
        with h5py.File(tmp_path / name / "spikes.h5") as file:
            assert (file["c/status"][1, :, 1] == -1).all() or name == "scaled"
            counts.append(len(file["trials/trial_id"]))
    assert counts == [22, 20]


def test_constant_taxels_are_named_and_harmless(session: Path, tmp_path: Path) -> None:
    def freeze(file: Any) -> None:
        samples = file["/taxels/samples"][:]
        samples[:, 4] = 512
        samples[:, 17] = 0
        file["/taxels/samples"][:] = samples

    damage(session, freeze)
    _, plain = analyse(session, tmp_path)
    assert "constant taxels, which read 0 and never spike: 5, 18" in remarks_of(plain)
    shares = plain["tasks"]["textures"]["representations"]["speed"]["mean"]
    assert shares[-1] > 0.5


def test_a_dead_sensor_gives_chance_accuracy_and_no_error(session: Path, tmp_path: Path) -> None:
    damage(session, lambda file: file["/taxels/samples"].__setitem__(slice(None), 300))
    _, plain = analyse(session, tmp_path)
    assert "constant taxels" in remarks_of(plain)
    curve = plain["tasks"]["textures"]["representations"]["original"]
    assert max(curve["mean"]) <= 0.5


def test_everything_bad_at_once_gives_a_report_of_numbers(session: Path, tmp_path: Path) -> None:
    def ruin(file: Any) -> None:
        _same_in_each_class(file)
        rows = file["/trials"][:]
        rows["verdict"][:3] = b"aborted"
        rows["first_sample"][5] = -1
        rows["mean_force_g"] = np.nan
        rows["verdict"][(rows["texture"] == b"A") & (rows["force_g"] == 250)] = b"rejected"
        file["/trials"][:] = rows
        cells = file["/loadcell"][:]
        cells["force_g"] = np.nan
        file["/loadcell"][:] = cells

    damage(session, ruin)
    out = tmp_path / "r"
    words = ["analyse", str(session), "--out", str(out), "--iterations", "1", "--k-max", "4"]
    assert main(words) == 0
    plain = json.loads((out / "results.json").read_text(), parse_constant=_refuse)
    remarks = remarks_of(plain)
    assert "no within-class variance) were set aside" in remarks
    assert "constant taxels, which read 0 and never spike: 10, 11" in remarks
    assert "C has no entry for combinations" in remarks and "attempts left out: " in remarks
    assert_only_numbers(out)


def _same_in_each_class(file: Any) -> None:
    """Make every sample depend on the texture and nothing else."""
    samples, rows = file["/taxels/samples"][:], file["/trials"][:]
    for row in rows:
        start, stop = row["first_sample"], row["first_sample"] + row["count"]
        samples[start:stop] = 200 + 100 * (row["texture"][0] % 8)
        samples[start + 100] = 0
    samples[:, 9:] = 512
    file["/taxels/samples"][:] = samples


def _refuse(word: str) -> None:
    raise AssertionError(word)


def assert_only_numbers(report: Path) -> None:
    """Assert that no attribute of a figure and no cell of a table is NaN or infinite."""
    for svg in report.glob("*.svg"):
        for element in ElementTree.parse(svg).iter():
            for name, value in element.attrib.items():
                if not name.endswith("href"):
                    assert not NO_NUMBER.search(value), f"{svg.name}: {name}={value[:80]}"
            assert not NO_NUMBER.search(element.text or ""), f"{svg.name}: {element.text}"
    for csv in report.glob("*.csv"):
        assert not NO_NUMBER.search(csv.read_text())


def test_a_part_still_being_written_gives_what_is_committed(tmp_path: Path) -> None:
    trials = plan().trials
    with recorder(tmp_path / "live") as rec:
        rec.begin_part("start", trials[0].texture)
        bench = SyntheticRig(rec)
        for trial in trials[:3]:
            bench.trial(trial)
        rec.wait_written()
        joined = join_sessions([tmp_path / "live"])
        assert [t.trial_id for t in joined.trials] == [t.trial_id for t in trials[:3]]
        assert "still being written" in "\n".join(joined.remarks)
        assert_readable(joined)


def test_files_cut_short_are_read_as_far_as_they_go_or_refused(good: Path, tmp_path: Path) -> None:
    """Cut before, in and behind the tables and the samples, and before the last byte."""
    (part,) = part_paths(good)
    whole = part.read_bytes()
    steps = range(len(whole) // 20, len(whole), len(whole) // 20)
    places = {1, 7, 100, 2_000, 20_000, len(whole) - 1, *steps}
    refused = 0
    for place in sorted(places):
        cut = tmp_path / f"cut-{place}"
        shutil.copytree(good, cut)
        (cut / part.name).write_bytes(whole[:place])
        try:
            joined = join_sessions([cut])
            assert_readable(joined)
        except SessionError as error:
            refused += 1
            assert str(cut) in str(error), place
    assert refused == len(places)


def assert_readable(joined: TrialSet) -> None:
    with open_trials(joined.files) as reader:
        for trial in joined.trials:
            reader.read(trial)


def test_the_commands_name_a_missing_part_and_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "s"
    record_four_parts(session, repeats=6)
    (session / "part-0002.h5").write_bytes(b"")
    line = "part-0002.h5 is damaged"
    assert main(["encode", str(session), "--out", str(tmp_path / "spikes"), "--no-cache"]) == 0
    assert line in capsys.readouterr().out
    report = str(tmp_path / "report")
    few = ["--task", "textures", "--iterations", "1", "--k-max", "2", "--no-cache"]
    assert main(["analyse", str(session), "--out", report, *few]) == 0
    assert line in capsys.readouterr().out
    assert line in (tmp_path / "report" / "report.html").read_text()
    assert main(["info", str(session)]) == 0
    assert line in capsys.readouterr().out
    assert main(["verify", str(session)]) == 1
    assert line in capsys.readouterr().out


def test_a_trial_whose_samples_cannot_be_read_is_named(good: Path, tmp_path: Path) -> None:
    joined = join_sessions([good])
    copy = Path(shutil.copytree(good, tmp_path / "copy"))
    (part,) = part_paths(copy)
    again = join_sessions([copy])
    end = part.stat().st_size
    with part.open("r+b") as file:
        file.truncate(end // 2)  # a disk that fails while the analysis runs
    message = f"{copy}: trial \\d+ cannot be read"
    with open_trials(again.files) as reader, pytest.raises(SessionError, match=message):
        for trial in joined.trials:
            reader.read(trial)
    with open_trials(again.files) as reader, pytest.raises(SessionError, match=message):
        reader.read_block(joined.trials)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"1..3"', '"1..9"'), "A_1.npy has no column '9'"),
        (('"1..3"', '"heat"'), "A_1.npy has no column 'heat'"),
        (("[A-Z]", "[0-9]{4}"), "A_1.npy: its name does not match the pattern"),
        (("(?P<texture>[A-Z])_", "(?P<texture>[A-Z])_(?P<speed>.*)"), "which is not a number"),
    ],
)
def test_impossible_imports_are_refused_with_the_file_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], message: str
) -> None:
    np.save(tmp_path / "A_1.npy", np.zeros((60, 3)))
    text = (
        "[files]\npattern = '(?P<texture>[A-Z])_'\n[labels]\nspeed_mm_s = 40\n"
        '[time]\nrate_hz = 1000\n[taxels]\ncolumns = ["1..3"]\n'
    )
    (tmp_path / "map.toml").write_text(text.replace(*change))
    words = ["import", "--map", str(tmp_path / "map.toml"), str(tmp_path / "A_1.npy")]
    assert main([*words, "--out", str(tmp_path / "s")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_a_taxel_or_trial_that_is_not_there_changes_one_figure(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["analyse", str(good), "--iterations", "1", "--k-max", "3", "--no-cache"]
    for number, (option, value, sentence) in enumerate(
        (
            ("--taxel", "19", "no taxel 19"),
            ("--trial", "999", "no session has a committed trial"),
            ("--start", "9", "--start 9 is behind the end of the trial"),
        )
    ):
        out = tmp_path / str(number)
        assert main([*words, option, value, "--out", str(out)]) == 0
        remarks = json.loads((out / "results.json").read_text())["remarks"]
        assert any(sentence in text and "shows the usual one" in text for text in remarks)
        assert f"figure of one taxel: {'there is ' if number == 0 else ''}{sentence}" in (
            capsys.readouterr().out
        )


def test_a_texture_at_one_level_is_not_tested_where_that_is_left_out(
    good: Path, tmp_path: Path
) -> None:
    single = record(tmp_path / "single", "D", travel_mm=12.0, speeds=(40,), forces=(500,))
    made = represent(join_sessions([good, single]), DEFAULT, tmp_path)
    for name in ("leave-speed-out", "leave-force-out"):
        (result,), remarks = run_tasks(made, SweepSettings(2, 3, tasks=(name,)))
        assert result.curves[0].confusion[result.classes.index("D")].sum() == 0
        assert any("textures left out" in text and text.endswith(": D") for text in remarks)


def test_the_figure_of_a_taxel_begins_at_a_chosen_time(good: Path, tmp_path: Path) -> None:
    words = ["analyse", str(good), "--iterations", "1", "--k-max", "3", "--no-cache"]
    out = tmp_path / "out"
    assert main([*words, "--start", "0.1", "--task", "textures", "--out", str(out)]) == 0
    assert "0.1 to " in (out / "fig2c.svg").read_text(encoding="utf-8")
    assert not [line for line in json.loads((out / "results.json").read_text())["remarks"]
                if "figure of one taxel" in line]  # fmt: skip
