"""A session that another program or firmware continues says so."""

from __future__ import annotations

from dataclasses import replace

from rigctl.session.header import describe_new_versions
from rigctl.values import BoardIdentity
from tests.session.building import header

DRUM = BoardIdentity("drum", "0.1", "aaaa", 5, 1, 0)


def test_what_is_as_before_is_not_told() -> None:
    before = replace(header(), boards=(DRUM,))
    assert (
        describe_new_versions(before, replace(before, boards=(replace(DRUM, boot_count=9),))) == []
    )


def test_a_new_firmware_is_told() -> None:
    before = replace(header(), boards=(DRUM,))
    (text,) = describe_new_versions(
        before, replace(before, boards=(replace(DRUM, build_hash="bbbb"),))
    )
    assert text.startswith("the drum board's firmware was 0.1 (build aaaa) in the last part")


def test_an_older_session_without_versions_is_continued_in_silence() -> None:
    before = replace(header(), software_version="", boards=())
    assert (
        describe_new_versions(before, replace(before, software_version="2", boards=(DRUM,))) == []
    )
