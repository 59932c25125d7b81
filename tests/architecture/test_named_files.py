"""The paper's page and its neighbours name only files, pages, settings and options that exist."""

from __future__ import annotations

import re
import shlex
from argparse import ArgumentParser, _SubParsersAction
from collections.abc import Iterator
from math import ceil
from pathlib import Path
from statistics import NormalDist

import pytest

from rigctl.analysis import published
from rigctl.analysis.statistics import wilson_interval
from rigctl.cli import create_parser, main
from rigctl.finger.published import FINGER_TASKS
from tests.architecture.imports import CHECKOUT

PAPER = "docs/explanation/paper.md"
STUDY = "docs/how-to/study-design.md"
PAGES = (PAPER, STUDY, "docs/reference/glossary.md")
CODE = re.compile(r"```.*?```|`[^`]*`", re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
PATH = re.compile(r"`((?:rigctl|gui|arduino|tests|protocols|docs)/[\w./-]+)`")
READ, SESSION = "docs/how-to/read-a-session.md", "docs/reference/session.md"
MATLAB_PAGES = (
    (READ, SESSION),
    *((f"docs/reference/{name}.md",) * 2 for name in ("session", "encode", "model")),
)
"""Pages with lines of MATLAB, and the pages that list what they read."""
ALL_PAGES = sorted(
    path.relative_to(CHECKOUT).as_posix()
    for pattern in ("*.md", "docs/**/*.md", "arduino/*.md")
    for path in CHECKOUT.glob(pattern)
)
OPTION = re.compile(r"(--[a-z][a-z-]+)")


def text_of(page: str) -> str:
    return (CHECKOUT / page).read_text(encoding="utf-8")


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def options(parser: ArgumentParser) -> Iterator[str]:
    for action in parser._actions:
        yield from action.option_strings
        if isinstance(action, _SubParsersAction):
            for below in action.choices.values():
                yield from options(below)


def test_every_link_leads_to_a_page_and_its_heading() -> None:
    """As on a forge; the site's own check is in tests/config/test_installed.py."""
    missing = []
    for page in ALL_PAGES:
        for link in LINK.findall(CODE.sub("", text_of(page))):
            name, _, anchor = link.partition("#")
            target = (CHECKOUT / page).parent / name if name else CHECKOUT / page
            if "://" not in link and not (
                target.exists() and (not anchor or anchor in anchors(target))
            ):
                missing.append((page, link))
    assert missing == []


@pytest.mark.parametrize("page", PAGES)
def test_every_named_file_exists(page: str) -> None:
    assert [name for name in PATH.findall(text_of(page)) if not (CHECKOUT / name).exists()] == []


def test_the_paper_page_names_files_of_both_experiments() -> None:
    named = set(PATH.findall(text_of(PAPER)))
    assert len(named) > 25
    for room in (
        "rigctl/encoder",
        "rigctl/analysis/published",
        "rigctl/finger/analysis",
        "arduino",
    ):
        assert any(name.startswith(room) for name in named), room


def test_every_command_of_a_page_is_understood() -> None:
    """Those in a block for a shell, but for those that leave something open."""
    parser, blocks = create_parser(), re.compile(r"```sh\n(.*?)```", re.DOTALL)
    text = "".join(block for page in ALL_PAGES for block in blocks.findall(text_of(page)))
    lines = [line for line in text.replace("\\\n", "").splitlines() if not {*"…|"} & {*line}]
    commands = [words for words in (shlex.split(line, comments=True) for line in lines) if words]
    ours = [words[1:] for words in commands if words[0] == "rigctl"]
    assert len(ours) > 80
    for words in ours:
        parser.parse_args(words)


@pytest.mark.parametrize("page", PAGES)
def test_every_option_is_one_of_the_command_line(page: str) -> None:
    known = set(options(create_parser()))
    assert [name for name in OPTION.findall(text_of(page)) if name not in known] == []


def test_the_paper_page_has_the_published_shares() -> None:
    page = text_of(PAPER)
    captions = [percent for _, percent in published.CONFUSION_PERCENT.values()]
    table = [mean for mean, _ in published.TABLE_1[published.CONFUSION_TASK].values()]
    for values in (captions, table):
        assert all(f"{percent:.2f}" in page for percent in values)
    gaps = [mean - percent for mean, percent in zip(table, captions, strict=True)]
    assert ", ".join(f"{gap:.2f}" for gap in gaps[:3]) in page and f"{gaps[3]:.2f} points" in page
    n_unconverged, n_entries = published.UNCONVERGED_C
    assert f"{n_unconverged} of {n_entries:,}" in page
    searched = n_entries - published.REFERENCE_C
    assert f"{searched:,} that were searched it is {n_unconverged / searched:.1%}" in page.replace(
        " %", "%"
    )


def test_the_paper_page_has_the_quoted_accuracies_of_the_finger() -> None:
    page = text_of(PAPER)
    for task in FINGER_TASKS:
        for quoted in task.quoted:
            at = f" at {quoted.components}" if quoted.components else ""
            assert re.search(rf"{quoted.percent:g} %{at}", page), (task.key, quoted)
        assert task.double == range(1, 71) or re.search(
            rf"from {task.double.start} to {task.double.stop - 1}", page
        )


def test_the_study_in_the_page_is_a_protocol(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", text_of(STUDY), re.DOTALL)
    (tmp_path / "study.toml").write_text(block)
    assert main(["check", str(tmp_path / "study.toml")]) == 0
    assert "8, each plate mounted 2 times" in capsys.readouterr().out


def test_the_numbers_of_trials_in_the_page_are_right() -> None:
    page = text_of(STUDY)
    for effect in (0.2, 0.5):
        # Cohen 1988, section 6.4: power 0.8, two-tailed at 0.05.
        n = 2 * ((NormalDist().inv_cdf(0.975) + NormalDist().inv_cdf(0.8)) / effect) ** 2
        assert re.search(rf"\b{ceil(n)}( trials)?\s+for\s+h = {effect}", page)
    for right, n in ((50, 100), (500, 1000)):
        low, high = wilson_interval(right, n)
        assert f"{100 * low:.0f} to {100 * high:.0f} %" in page


@pytest.mark.parametrize(("page", "lister"), MATLAB_PAGES)
def test_matlab_reads_data_sets_that_a_page_lists(page: str, lister: str) -> None:
    blocks = re.findall(r"```matlab\n(.*?)```", text_of(page), re.DOTALL)
    read = [path for block in blocks for path in re.findall(r'h5read\(\w+, "([^"]+)"', block)]
    listed = re.sub(r"```matlab\n.*?```", "", text_of(lister), flags=re.DOTALL)
    assert read
    for path in read:
        group, _, name = path.rpartition("/")
        row = rf"^(?:\| |### )`{re.escape(group)}/[^|]*\b{re.escape(name)}`"
        assert re.search(row, listed, re.MULTILINE), path


def test_the_glossary_has_each_word_once_in_order() -> None:
    rows = re.findall(r"^\| ([^|]+?) \|", text_of("docs/reference/glossary.md"), re.MULTILINE)
    words = [re.sub(r"\W", "", word.partition(" (")[0]).lower() for word in rows[1:]]
    assert len(words) == len(set(words)) > 50
    assert words == sorted(words)
