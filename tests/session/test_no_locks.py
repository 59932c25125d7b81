"""A file system without locks, as many network drives are: sessions are read, none is written."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

NO_LOCKS = """
#include <errno.h>
int flock(int file, int operation) { (void)file; (void)operation; errno = ENOLCK; return -1; }
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile a library in whose presence no file can be locked."""
    folder = tmp_path_factory.mktemp("library")
    (folder / "no_locks.c").write_text(NO_LOCKS)
    built = folder / "no_locks.so"
    command = ["gcc", "-shared", "-fPIC", "-o", str(built), str(folder / "no_locks.c")]
    subprocess.run(command, check=True)
    return built


def rigctl(library: Path, *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rigctl", *map(str, words)]
    environment = os.environ | {"LD_PRELOAD": str(library)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_sound_session_is_read_and_called_sound(library: Path, session: Path) -> None:
    done = rigctl(library, "verify", session)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert "damaged" not in done.stdout
    out = session.parent / "encoded"
    done = rigctl(library, "encode", session, "--out", out)
    assert done.returncode == 0, done.stderr
    assert (out / "spikes.h5").is_file()


def test_nothing_is_written_and_the_sentence_says_where_to_write(
    library: Path, session: Path
) -> None:
    before = {path: path.read_bytes() for path in session.iterdir()}
    for command in (["recover", session], ["note", session, "a note"]):
        done = rigctl(library, *command)
        assert done.returncode != 0 or "nothing" in done.stdout, done.stdout
        assert "is being written" not in done.stderr
    assert {path: path.read_bytes() for path in before} == before
    done = rigctl(
        library,
        "synth",
        "--plan",
        "protocols/quick.toml",
        "--seed",
        1,
        "--out",
        session.parent / "new",
    )
    assert done.returncode != 0
    assert "is on a file system without locks (No locks available)" in done.stderr
    assert "write on a local disk, and copy the session afterwards" in done.stderr
