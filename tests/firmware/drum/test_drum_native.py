"""Tests without a chip: generated files, and the C++ tests under sanitizers."""

from __future__ import annotations

import subprocess

from rigctl.boards.codegen.__main__ import GENERATED, find_stale
from rigctl.config.resources import checkout
from tests.firmware.building import built


def test_headers_and_page_agree_with_the_tables() -> None:
    assert find_stale() == {}


def test_a_stale_header_is_detected() -> None:
    root = checkout()
    assert root is not None
    stale = find_stale(root / "docs")
    assert stale.keys() == GENERATED.keys()
    assert stale == {path: (root / path).read_text(encoding="utf-8") for path in stale}


def test_the_cpp_tests_pass_under_sanitizers() -> None:
    done = subprocess.run(
        [str(built("firmware/native-drum"))], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
