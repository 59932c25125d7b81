"""What needs no chip: the generated files, and the C++ tests under sanitizers."""

from __future__ import annotations

import subprocess

from rigctl.config.resources import checkout
from rigctl.wire import codegen
from tests.firmware.building import built


def test_headers_and_page_say_what_the_tables_say() -> None:
    assert codegen.find_stale() == {}


def test_a_changed_header_is_noticed() -> None:
    root = checkout()
    assert root is not None
    path, text = next(iter(codegen.generate().items()))
    assert text == (root / path).read_text(encoding="utf-8")
    assert codegen.find_stale(root / "docs") == codegen.generate()


def test_the_pure_parts_pass_their_tests_under_sanitizers() -> None:
    done = subprocess.run(
        [str(built("firmware/native-drum"))], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
