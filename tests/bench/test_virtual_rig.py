"""The virtual rig as a whole: the same for a seed, whatever the slices; faults on its cables."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from rigctl.bench.parameters import WorldParameters
from rigctl.bench.virtual_rig import VirtualRig, open_virtual_rig
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import Fault, State
from rigctl.boards.taxel_frames import IDENTIFY, SELF_TEST, Flag, SelfTestBit, encode_request
from rigctl.errors import LinkLost, WrongUse
from tests.bench.host import Host, framed


def trace(seed: int, slices_us: tuple[int, ...], parameters: WorldParameters) -> str:
    """Return a hash of all received bytes and the ground truth of a short session."""
    rig = open_virtual_rig(parameters, seed)
    rig.set_plate("L")
    heard = hashlib.sha256()
    rig.drum.open(lambda data, at_s: heard.update(b"%r %r" % (data, at_s)), lambda why: None)
    taxels: list[bytes] = []
    rig.taxels.open(lambda data, at_s: taxels.append(data), lambda why: None)
    host = iter(range(10**6))
    for at_ms, request in SESSION:
        while rig.time_us < 1000 * at_ms:
            step = slices_us[next(host) % len(slices_us)]
            rig.advance(min(1000 * at_ms, rig.time_us + step))
        rig.drum.write(request)
    truth = rig.truth.arrays()
    heard.update(b"".join(taxels) + truth.speed_mm_s.tobytes() + truth.force_g.tobytes())
    return heard.hexdigest()


def _session() -> list[tuple[int, bytes]]:
    """Requests of a host that arms, presses and runs, each at a fixed time."""

    def command(number: int, code: Command) -> bytes:
        head = bytes([1, 16, 0, 64, 0, 3, 6])
        return framed(head + b"".join(w.to_bytes(2, "big") for w in (number, code, number)))

    beats = [(at, command(n, Command.NONE)) for n, at in enumerate(range(200, 6000, 100), 100)]
    requests = {250: command(1, Command.COMMISSION), 300: command(2, Command.ARM)}
    requests |= {1500: command(3, Command.TARE), 2100: command(4, Command.APPROACH)}
    requests |= {4500: command(5, Command.RUN)}
    merged = dict(beats) | requests
    return sorted(merged.items())


SESSION = _session()
NEAR = WorldParameters(contact_mm=10.0, actuator_start_mm=8.0)


def test_two_runs_of_a_seed_are_bit_equal_and_another_seed_is_not() -> None:
    assert trace(5, (5000,), NEAR) == trace(5, (5000,), NEAR)
    assert trace(5, (5000,), NEAR) != trace(6, (5000,), NEAR)


@pytest.mark.parametrize("slices_us", [(1000,), (1, 7, 333, 4999), (50_000,)])
def test_any_slicing_gives_the_same_bytes(slices_us: tuple[int, ...]) -> None:
    assert trace(5, slices_us, NEAR) == trace(5, (5000,), NEAR)


@pytest.fixture
def rig() -> VirtualRig:
    return open_virtual_rig(seed=2)


@pytest.fixture
def host(rig: VirtualRig) -> Host:
    return Host(rig)


def test_frames_come_at_the_boards_own_rate(rig: VirtualRig, host: Host) -> None:
    host.wait(10_000_000)
    frames = sum(len(block) for block in host.blocks)
    rate_hz = frames / (rig.time_us / 1e6 - 0.006)
    assert rate_hz == pytest.approx(1000 * (1 - 900e-6), abs=0.15)
    assert host.rejected == 0
    assert not any(block.gaps for block in host.blocks)
    assert len(host.statuses) == frames // 100


def test_the_taxel_board_replies_to_requests(rig: VirtualRig, host: Host) -> None:
    host.wait(50_000)
    assert len(host.identities) == 1
    rig.taxels.write(encode_request(IDENTIFY))
    rig.taxels.write(encode_request(SELF_TEST))
    host.wait(150_000)
    assert len(host.identities) == 2
    assert [test.count for test in host.self_tests] == [1, 1, 2]
    assert all(test.passed for test in host.self_tests)
    assert host.statuses[-1].self_test_bits == SelfTestBit.DONE


def test_sync_and_index_edges_reach_the_taxel_board(rig: VirtualRig, host: Host) -> None:
    host.holding()
    host.command(Command.RUN)
    host.state(State.HOLD)
    host.wait(20_000)
    counters = np.concatenate([b.counters for b in host.blocks])
    edges = np.concatenate([b.edges for b in host.blocks])
    flags = np.concatenate([b.flags for b in host.blocks])
    assert edges[-1] % 4 == 1
    high = counters[flags & Flag.SYNC > 0]
    assert high.size == pytest.approx(245 / 80 / 1.0012 * 1000 * (1 - 900e-6), abs=1)
    assert np.all(np.diff(high) == 1)
    change = counters[1:][np.diff(edges % 4) != 0]
    assert change.tolist() == [high[0]]


def test_every_index_mark_is_counted_on_both_boards(host: Host) -> None:
    host.armed()
    host.put("move_target", 3 * 12800)
    host.command(Command.MOVE)
    poll = host.until(lambda poll: poll["command_result"] == 1)
    host.wait(20_000)
    marks = sum(int(np.count_nonzero(b.flags & Flag.INDEX)) for b in host.blocks)
    assert poll["index_count"] == marks == 3
    assert host.blocks[-1].edges[-1] >> 2 == 3


def test_unplug_is_reported_once_and_replug_opens_again(rig: VirtualRig, host: Host) -> None:
    rig.faults.unplug("drum")
    assert len(host.lost) == 1
    assert "vanished" in host.lost[0]
    with pytest.raises(LinkLost, match="closed"):
        rig.drum.write(b"x")
    with pytest.raises(LinkLost, match="no such port"):
        rig.drum.open(lambda data, at_s: None, host.lost.append)
    rig.faults.replug("drum")
    rig.taxels.close()
    again = Host(rig)
    again.wait(100_000)
    assert again.get("boot_count") == 1


def test_an_open_port_is_in_use(rig: VirtualRig, host: Host) -> None:
    with pytest.raises(LinkLost, match="in use"):
        rig.taxels.open(lambda data, at_s: None, host.lost.append)


def test_a_stalled_cable_is_silent_and_recovers(rig: VirtualRig, host: Host) -> None:
    host.wait(100_000)
    rig.faults.stall("taxels", True)
    before = len(host.blocks)
    host.wait(100_000)
    assert len(host.blocks) == before
    rig.faults.stall("taxels", False)
    host.wait(100_000)
    assert sum(gap.count for b in host.blocks for gap in b.gaps) == pytest.approx(100, abs=10)


def test_a_noisy_cable_loses_frames_that_are_counted(rig: VirtualRig, host: Host) -> None:
    host.wait(100_000)
    rig.faults.corrupt_bytes("taxels", "to_host", 0.001)
    host.wait(2_000_000)
    rig.faults.corrupt_bytes("taxels", "to_host", 0.0)
    host.wait(500_000)
    lost = sum(gap.count for b in host.blocks for gap in b.gaps)
    got = sum(len(b) for b in host.blocks)
    assert 20 < lost < 200
    assert got + lost == host.blocks[-1].counters[-1] + 1


def test_reset_of_the_taxel_board_restarts_its_counter(rig: VirtualRig, host: Host) -> None:
    host.wait(300_000)
    rig.faults.reset("taxels")
    host.wait(300_000)
    assert host.identities[-1].boot_count == 2
    assert host.blocks[-1].counters[-1] < 300


def test_faults_of_the_drum_reach_it_with_a_dropped_request(rig: VirtualRig, host: Host) -> None:
    host.holding()
    rig.faults.drop_bytes("drum", "to_board", 1.0)
    assert host.ask(b"\0" * 8) == b""
    host.wait(1_200_000)
    rig.faults.drop_bytes("drum", "to_board", 0.0)
    host.wait(20_000)
    assert host.fault() is Fault.HEARTBEAT


def test_an_unknown_plate_is_rejected_with_a_sentence(rig: VirtualRig) -> None:
    with pytest.raises(WrongUse, match="A to P"):
        rig.set_plate("Q")
