"""The first step of Set up: boards found and flashed before connecting, on chips."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtTest import QTest

from gui.operate.boards_box import FLASH_CANCELLED, NO_WHOLE_PATH, RELEASED, BoardsBox
from gui.operate.setup_page import SetupPage
from rigctl.bench.chips.simavr import Kind
from rigctl.boards.drum_registers import BOARD_DRUM, BOARD_TAXELS, MAGIC
from rigctl.boards.flash import WAIT_FOR_EVER, Flashed
from rigctl.boards.identity import drum_identity, offered_flash, taxel_identity
from rigctl.boards.taxel_frames import TaxelIdentity
from rigctl.config.intel_hex import parse_intel_hex
from rigctl.config.rig_config import load_config
from rigctl.errors import LinkLost, RigFault, WrongBoard, WrongUse
from rigctl.values import BoardIdentity
from tests.boards.flash_board import FlashBoard
from tests.boards.test_flash import usb_port
from tests.firmware.bootloaders import MEGA, UNO
from tests.firmware.building import built
from tests.gui.steps import Harness, SharedWindow, click, wait_until

BOARD_MS = 120_000
REFUSAL = (
    "/dev/ttyACM0: the drum board's firmware 0.1 speaks register map 3, this program map 4: to "
    "give it this installation's firmware, `rigctl flash drum`"
)


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give a bootloader more time than on a bench: chips run slower on a busy computer."""
    monkeypatch.setattr("rigctl.boards.flash.ANSWER_S", 0.5)
    monkeypatch.setattr("rigctl.boards.flash.CLOSED_S", 0.5)
    monkeypatch.setattr("rigctl.boards.boot_silence.ASK_S", 4.0)


@pytest.fixture
def page(disconnected: SharedWindow, plug: Callable[..., None]) -> Iterator[SetupPage]:
    """Yield the page Set up of a window that is connected to nothing, and has found nothing."""
    window = disconnected.window
    action = next(a for _, a in window.menus.actions() if a.text() == "Set &up …")
    action.trigger()
    page = window.tools.setup_page
    page.boards.rig_file.clear()
    plug()
    click(page.boards.find_button)
    rest(page.boards)
    yield page
    page.boards.worker.close()
    wait_until(lambda: not page.boards.worker.is_busy)
    window.tools.flash_strip.hide()


@pytest.fixture
def plug(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Return what plugs boards into this computer."""

    def plugged(*boards: FlashBoard) -> None:
        ports = [usb_port(board.port, description="Arduino") for board in boards]
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)

    return plugged


def rest(boards: BoardsBox) -> None:
    wait_until(lambda: not boards.worker.is_busy, BOARD_MS)


def drum_board() -> FlashBoard:
    return FlashBoard(built("firmware/drum.elf"), Kind.DRUM, MEGA)


def empty_uno() -> FlashBoard:
    """Return a taxel board whose program was interrupted while it was written."""
    board = FlashBoard(built("firmware/taxels.elf"), Kind.TAXELS, UNO)
    board.chip.write_flash(0, WAIT_FOR_EVER.ljust(256, b"\xff"))
    built("firmware/taxels.hex")
    return board


def test_boards_are_found_flashed_and_connected_by_what_they_say_of_themselves(
    page: SetupPage, plug: Callable[..., None], disconnected: SharedWindow, tmp_path: Path
) -> None:
    boards, path = page.boards, tmp_path / "rig.toml"
    with drum_board() as mega, empty_uno() as uno:
        plug(uno, mega)
        click(boards.find_button)
        assert not boards.flash_buttons["drum"].isEnabled()
        rest(boards)
        assert f"{mega.port} (Arduino): drum board, firmware" in boards.found.text()
        assert f"{uno.port} (Arduino): no rigctl board answered" in boards.found.text()
        assert boards.expected.text().startswith("Expected: a drum board and a taxel board, with")
        assert "no port answers as the taxel board" in boards.problem.text()
        boards.port.setCurrentText(uno.port)
        click(boards.flash_buttons["taxels"])
        wait_until(lambda: boards.progress.value() > 0, BOARD_MS)
        assert boards.progress.isVisible() and boards.state.text().startswith("Writing")
        rest(boards)
        assert "is written and verified" in boards.state.text(), boards.state.text()
        assert f"{uno.port}: taxel board, firmware" in boards.found.text()
        assert not boards.problem.text() and not boards.progress.isVisible()
        image = parse_intel_hex(built("firmware/taxels.hex").read_text())
        assert all(uno.chip.read_flash(at, len(data)) == data for at, data in image)
        QTest.keyClicks(boards.rig_file, str(path))
        click(boards.connect_button)
        ports = load_config(path).ports
        assert (ports.drum, ports.taxels) == (mega.port, uno.port)
        assert path.read_text().startswith("# Written by rigctl setup")
        wait_until(lambda: disconnected.opened == [(str(path), "")])
    wait_until(lambda: disconnected.window.engine_link.is_connected)


def test_a_flash_is_cancelled_leaves_the_board_safe_and_begins_again(
    page: SetupPage, plug: Callable[..., None]
) -> None:
    boards = page.boards
    with empty_uno() as uno:
        plug(uno)
        click(boards.flash_buttons["taxels"])
        wait_until(lambda: boards.state.text().startswith("Writing"), BOARD_MS)
        click(boards.cancel_button)
        rest(boards)
        assert boards.state.text() == FLASH_CANCELLED
        assert uno.chip.read_flash(0, len(WAIT_FOR_EVER)) == WAIT_FOR_EVER
        click(boards.flash_buttons["taxels"])
        rest(boards)
        assert "is written and verified" in boards.state.text(), boards.state.text()


@pytest.mark.parametrize(
    "error",
    [
        WrongUse("avrdude is not installed: sudo apt install avrdude"),
        LinkLost("/dev/ttyACM0: the port is in use: close the program that holds it"),
    ],
)
def test_what_hinders_a_flash_is_one_sentence(
    page: SetupPage, monkeypatch: pytest.MonkeyPatch, error: RigFault
) -> None:
    async def fail(*_: Any) -> Flashed:
        raise error

    monkeypatch.setattr("rigctl.boards.flash.flash_board", fail)
    click(page.boards.flash_buttons["drum"])
    rest(page.boards)
    assert page.boards.state.text() == str(error)
    assert page.boards.flash_buttons["drum"].isEnabled()


def test_without_any_port_the_page_says_what_to_do(page: SetupPage) -> None:
    assert page.boards.problem.text().startswith("there is no serial port: plug both boards in")


def test_a_rig_toml_that_is_none_is_refused_in_a_sentence(
    page: SetupPage, disconnected: SharedWindow, tmp_path: Path
) -> None:
    path = tmp_path / "no folder" / "rig.toml"
    QTest.keyClicks(page.boards.rig_file, str(path))
    click(page.boards.connect_button)
    assert "cannot be written" in page.boards.state.text() and not disconnected.opened
    page.boards.rig_file.clear()
    for text in ("", "rig.toml"):
        QTest.keyClicks(page.boards.rig_file, text)
        click(page.boards.connect_button)
        assert page.boards.state.text() == NO_WHOLE_PATH and not disconnected.opened


def test_the_rig_toml_that_is_chosen_at_the_top_is_proposed(
    disconnected: SharedWindow, page: SetupPage, tmp_path: Path
) -> None:
    rig = disconnected.window.toolbar.rig
    rig.choose(str(tmp_path / "rig.toml"))
    rig.choose("virtual")
    assert page.boards.rig_file.text() == str(tmp_path / "rig.toml")


def test_a_board_that_does_not_match_is_offered_to_be_flashed(
    disconnected: SharedWindow, page: SetupPage, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, str]] = []

    async def flash(board: str, report: object, port: str) -> Flashed:
        asked.append((board, port))
        return Flashed(port, BoardIdentity(board, "0.1", "0badc0de", 4, 2, 0, {}), "")

    monkeypatch.setattr("rigctl.boards.flash.flash_board", flash)
    window, strip = disconnected.window, disconnected.window.tools.flash_strip
    disconnected.error = WrongBoard(REFUSAL)
    window.connect_rig("virtual")
    wait_until(strip.isVisible)
    assert strip.text.text() == REFUSAL and strip.flash.text() == "Flash the drum board"
    click(strip.dismiss)
    assert not strip.isVisible()
    window.connect_rig("virtual")
    wait_until(strip.isVisible)
    click(strip.flash)
    assert not strip.isVisible() and window.stack.currentWidget() is page
    rest(page.boards)
    assert asked == [("drum", "/dev/ttyACM0")]
    assert "is written and verified" in page.boards.state.text()


def test_other_refusals_offer_nothing(disconnected: SharedWindow, page: SetupPage) -> None:
    disconnected.error = LinkLost("/dev/ttyACM0: no drum board answered within 1 s")
    disconnected.window.connect_rig("virtual")
    wait_until(lambda: "no drum board answered" in disconnected.window.event_log.toPlainText())
    assert not disconnected.window.tools.flash_strip.isVisible()


def test_a_board_of_another_build_is_offered_to_be_flashed_after_the_rig_lets_it_go(
    harness: Harness,
) -> None:
    window, strip = harness.window, harness.window.tools.flash_strip
    text = "drum board connected; this installation brings build cafe: rigctl flash drum"
    harness.engine.send_event("board", text, board="drum", flash_at="/dev/x")
    window.poll()
    assert strip.isVisible() and strip.text.text() == text
    click(strip.flash)
    assert not window.engine_link.is_connected
    assert window.tools.setup_page.boards.state.text() == RELEASED
    wait_until(window.tools.setup_page.boards.isVisible)


def test_the_part_firmware_leads_to_flashing(harness: Harness) -> None:
    window, page = harness.window, harness.window.tools.setup_page
    window.tools.show_setup()
    part = {
        "name": "firmware",
        "title": "Firmware",
        "picture": "mega#arduino-uno",
        "state": "wrong",
    }
    harness.update(simulated=False, setup={"parts": [part]})
    assert page.parts.isVisible() and not page.boards.isVisible()
    click(page.flash_button)
    assert page.boards.isVisible() and not page.parts.isVisible()


def test_the_refusals_of_both_boards_name_board_and_port() -> None:
    raw = dict.fromkeys(("firmware_version", "map_version"), (3,))
    raw |= {"magic": (MAGIC,), "board_id": (BOARD_DRUM,)}
    with pytest.raises(WrongBoard) as refused:
        drum_identity("COM4", raw)
    assert offered_flash(f"connecting: {refused.value}") == ("drum", "COM4")
    assert offered_flash(REFUSAL) == ("drum", "/dev/ttyACM0")
    assert offered_flash("COM4: no drum board answered") is None
    reported = TaxelIdentity(MAGIC, 1, BOARD_TAXELS, 3, 0, 18, 1000, 1, 0, 800, 20)
    with pytest.raises(WrongBoard) as refused:
        taxel_identity("/dev/ttyUSB0", reported)
    assert offered_flash(str(refused.value)) == ("taxels", "/dev/ttyUSB0")
