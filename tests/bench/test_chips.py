"""Both firmware images on simulated chips: two clocks, two cables, one bench."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rigctl.bench.chips.rig import BoardClock, ChipSimulation, open_chip_simulation
from rigctl.bench.parameters import WorldParameters
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import Fault, State
from rigctl.boards.taxel_frames import IDENTIFY, encode_request
from rigctl.errors import RigFault
from tests.bench.host import BOOT_US, Host
from tests.firmware.building import built
from tests.firmware.taxels.chip import TaxelChip

POWER_ON, EXTERNAL = 1, 2


def opened(seed: int = 1, parameters: WorldParameters | None = None) -> ChipSimulation:
    """A bench with the real images."""
    built("sim/libchips.so")
    images = built("firmware/drum.elf"), built("firmware/taxels.elf")
    simulation = open_chip_simulation(parameters or WorldParameters(), seed, *images)
    assert isinstance(simulation, ChipSimulation)
    return simulation


@pytest.fixture
def host() -> Iterator[Host]:
    """A host at a bench that has just booted."""
    simulation = opened()
    yield Host(simulation)
    simulation.close()


@pytest.fixture(scope="module")
def run() -> Iterator[Host]:
    """A host that has lifted, pressed and run one trial."""
    simulation = opened(seed=3)
    host = Host(simulation)
    host.wait(BOOT_US)
    host.put("speed_set", 12000)
    host.put("travel_set", 1200)
    host.holding(500.0)
    host.command(Command.RUN)
    host.state(State.RUN)
    host.state(State.HOLD)
    host.command(Command.RETRACT)
    host.state(State.ARMED)
    yield host
    simulation.close()


def test_both_boards_identify_themselves(host: Host) -> None:
    host.wait(BOOT_US)
    assert host.get("magic") == 0x5247 and host.get("board_id") == 1
    assert host.get("boot_count") == 1 and host.get("reset_cause") == POWER_ON
    assert [i.board_id for i in host.identities] == [2]


def test_each_board_runs_on_its_own_clock() -> None:
    wrong = WorldParameters(drum_clock_ppm=5000.0, taxel_clock_ppm=-5000.0)
    simulation = opened(parameters=wrong)
    host = Host(simulation)
    host.wait(500_000)
    before = host.poll()
    began_us, began_frames = simulation.time_us, sum(len(b) for b in host.blocks)
    host.wait(2_000_000)
    host.wait(4000 - simulation.time_us % 4000)
    passed_us = simulation.time_us - began_us
    ran = sum(len(b) for b in host.blocks) - began_frames
    assert abs(ran - passed_us * 0.995e-3) <= 6  # frames come four at a time
    clock_us = host.poll()["board_time_us"] - before["board_time_us"]
    assert abs(clock_us / (simulation.time_us - began_us) - 1.005) < 0.005
    simulation.close()


def test_clocks_convert_exactly_and_back() -> None:
    clock = BoardClock(1200.0, on_us=250)
    assert clock.cycle(250) == 0 and clock.cycle(0) == 0
    days_us = 3 * 86_400_000_000
    assert clock.cycle(days_us + 250) == days_us * 16 * 10012 // 10000
    assert clock.us(clock.cycle(days_us + 250)) == pytest.approx(days_us + 250, abs=0.1)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    def fingerprint(seed: int) -> str:
        simulation = opened(seed)
        host = Host(simulation)
        host.idle()
        host.command(Command.ARM)
        host.attend(300_000)
        digest = hashlib.sha256(b"".join(host.taxel_bytes) + host.drum_bytes).hexdigest()
        simulation.close()
        return digest

    assert fingerprint(1) == fingerprint(1)
    assert fingerprint(1) != fingerprint(2)


def _cycle_of_frame_zero() -> int:
    """Return the cycle of the board's first sample after a reset."""
    with TaxelChip() as alone:
        alone.run(2)
        return int(alone.sampled(0)[0])


def test_the_first_sample_of_a_trial_is_the_first_frame_that_starts_after_sync(run: Host) -> None:
    simulation = run.simulation
    assert isinstance(simulation, ChipSimulation)
    counters = np.concatenate([b.counters for b in run.blocks])
    rises = np.concatenate([b.edges for b in run.blocks]) & 3
    assert np.array_equal(counters, np.arange(counters.size) + counters[0])
    (changed,) = np.flatnonzero(np.diff(rises.astype(int)))
    first_sample = int(counters[changed + 1]) + 1
    sync = simulation.truth.arrays().sync
    rise_ms = int(np.flatnonzero(np.diff(sync.astype(int)) == 1)[0]) + 1
    starts = first_sample * 16_000 + _cycle_of_frame_zero()
    starts_ms = simulation.taxels_board.clock.us(starts) / 1000
    assert 0 <= starts_ms - rise_ms < 2  # truth names the millisecond in which sync rose


def test_the_sync_window_covers_the_set_travel_at_the_set_force(run: Host) -> None:
    truth = run.simulation.truth.arrays()
    inside = truth.sync == 1
    travel_mm = truth.speed_mm_s[inside].sum() / 1000
    assert travel_mm == pytest.approx(120.0, abs=0.3)
    assert truth.speed_mm_s[inside].mean() == pytest.approx(120.0 * 1.0012, rel=1e-3)
    assert truth.force_g[inside].mean() == pytest.approx(500.0, rel=0.02)


def test_the_drum_position_matches_the_firmwares_step_count(run: Host) -> None:
    simulation = run.simulation
    assert isinstance(simulation, ChipSimulation)
    began = WorldParameters().start_mm / WorldParameters().mm_per_step
    turned = simulation.drum_board.chip.io.drum_steps - round(began)
    assert turned == run.poll()["steps"]
    assert simulation.drum_board.chip.io.overflows == 0


def test_every_conversion_of_the_load_cell_is_read_once(run: Host) -> None:
    simulation = run.simulation
    assert isinstance(simulation, ChipSimulation)
    x = simulation.drum_board.chip.io
    assert x.loadcell_conversions > 100
    assert x.loadcell_conversions - x.loadcell_reads <= 1


def test_texture_moves_the_taxels_while_the_drum_turns(run: Host) -> None:
    samples = np.concatenate([b.samples for b in run.blocks]).astype(float)
    rises = np.concatenate([b.edges for b in run.blocks]) & 3
    inside = samples[rises == rises.max()][:900]
    assert inside.mean() > samples[:200].mean() + 50


def test_reset_button_counts_a_boot_and_the_other_board_keeps_running(host: Host) -> None:
    host.wait(BOOT_US)
    host.simulation.faults.reset("taxels")
    host.wait(BOOT_US)
    assert host.identities[-1].boot_count == 2
    assert host.identities[-1].reset_cause == EXTERNAL
    assert host.get("boot_count") == 1
    host.simulation.faults.reset("drum")
    host.wait(BOOT_US)
    assert host.get("boot_count") == 2


def test_emergency_stop_reaches_the_pin(host: Host) -> None:
    host.idle()
    host.command(Command.ARM)
    host.simulation.faults.press_estop()
    host.wait(5000)
    assert host.fault() is Fault.ESTOP
    host.simulation.faults.release_estop()
    host.wait(5000)
    host.command(Command.CLEAR)
    assert host.get("state") == State.IDLE


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("loadcell_silent", Fault.LOADCELL_SILENT),
        ("loadcell_frozen", Fault.LOADCELL_FROZEN),
        ("loadcell_saturated", Fault.LOADCELL_SATURATED),
    ],
)
def test_load_cell_faults_reach_the_amplifier(host: Host, fault: str, expected: Fault) -> None:
    host.idle()
    host.command(Command.ARM)
    host.attend(100_000)
    getattr(host.simulation.faults, fault)()
    poll = host.until(lambda poll: poll["fault"] != 0, 2_000_000)
    assert poll["fault"] == expected


def test_an_unplugged_board_keeps_running_and_replies_again(host: Host) -> None:
    host.wait(BOOT_US)
    host.simulation.faults.unplug("taxels")
    assert host.lost == ["taxels: the port vanished: plug the board in again"]
    host.wait(BOOT_US)
    host.simulation.faults.replug("taxels")
    host.simulation.drum.close()
    later = Host(host.simulation)
    later.simulation.taxels.write(encode_request(IDENTIFY))
    later.wait(20_000)
    assert later.identities[-1].boot_count == 1


def test_a_missing_image_raises_a_sentence_with_the_remedy(tmp_path: Path) -> None:
    built("sim/libchips.so")
    with pytest.raises(RigFault, match="run `make firmware`"):
        open_chip_simulation(WorldParameters(), 1, tmp_path / "drum.elf", tmp_path / "taxels.elf")
