"""Protocols, pages and images are found in a checkout."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.config import resources
from rigctl.errors import ProtocolError, WrongUse

ROOT = Path(__file__).resolve().parents[2]


def test_a_checkout_finds_its_own_protocols(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert resources.checkout() == ROOT
    monkeypatch.chdir(tmp_path)
    shipped = ROOT / "protocols" / "quick.toml"
    for name in ("quick", "quick.toml", "protocols/quick.toml"):
        assert resources.find_protocol(name) == shipped
    (tmp_path / "quick.toml").write_text("")
    assert resources.find_protocol("quick.toml") == Path("quick.toml")
    with pytest.raises(ProtocolError, match="quick, sensor, showcase"):
        resources.find_protocol("elsewhere/quick.toml")


def test_a_missing_image_says_how_to_build_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(resources, "checkout", lambda: tmp_path)
    with pytest.raises(WrongUse, match="run make firmware"):
        resources.firmware_image("drum")
    image = tmp_path / "build" / "firmware" / "taxels.elf"
    image.parent.mkdir(parents=True)
    image.write_bytes(b"")
    assert resources.firmware_image("taxels") == image


def test_the_commit_is_read_from_the_checkout(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(resources, "checkout", lambda: tmp_path)
    assert resources.source_commit() == ""
    branch = tmp_path / ".git" / "refs" / "heads" / "main"
    branch.parent.mkdir(parents=True)
    (tmp_path / ".git" / "HEAD").write_text("ref: refs/heads/main\n")
    (tmp_path / ".git" / "packed-refs").write_text(f"# pack-refs\n{'b' * 40} refs/heads/main\n")
    assert resources.source_commit() == "b" * 40
    branch.write_text("a" * 40 + "\n")
    assert resources.source_commit() == "a" * 40
    (tmp_path / ".git" / "HEAD").write_text("c" * 40)
    assert resources.source_commit() == "c" * 40
    monkeypatch.setattr(resources, "checkout", lambda: None)
    assert resources.source_commit() == ""


def test_help_opens_the_site_or_the_page_as_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(resources, "checkout", lambda: tmp_path)
    assert resources.documentation() == tmp_path / "docs" / "README.md"
    page = tmp_path / "build" / "site" / "docs" / "README.html"
    page.parent.mkdir(parents=True)
    page.write_text("")
    assert resources.documentation() == page
