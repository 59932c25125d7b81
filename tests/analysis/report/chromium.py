"""A page in Debian's Chromium, where it is installed: what a script in the page finds out."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium")


def ask_page(page: Path, script: str) -> Any:
    """Return what ``script`` hands to ``answer`` in a page, None where it never does.

    The clock of the page jumps: it has minutes, and the test waits for the work only.
    """
    before, end, after = page.read_text("utf-8").rpartition("</body>")
    probe = "<script>function answer(v) { document.title = JSON.stringify(v); }\n"
    copy = page.with_name("asked.html")
    copy.write_text(f"{before}{probe}{script}</script>{end}{after}", "utf-8")
    assert CHROMIUM is not None
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--window-size=1300,1600",
        f"--user-data-dir={page.parent / 'chromium'}", "--virtual-time-budget=120000",
        "--dump-dom", copy.resolve().as_uri(),
    ]  # fmt: skip
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    copy.unlink()
    shutil.rmtree(page.parent / "chromium", ignore_errors=True)
    title = re.search("<title>(.*?)</title>", run.stdout, re.DOTALL)
    assert title is not None
    words = unescape(title[1])
    return json.loads(words) if words.startswith(("{", "[")) else None
