"""Trackers on cables, sockets and files: what they deliver, count, and how they are lost."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigctl.errors import LinkLost, WrongUse
from rigctl.finger.trackers.open_tracker import RecordedTrack, open_tracker, read_track
from rigctl.finger.trackers.streaming import SerialTracker, SourceClock, UdpTracker
from rigctl.values import Position
from tests.boards.memory_link import JumpingLoop, MemoryLink


class TrackerListener:
    """Collects positions and losses."""

    def __init__(self) -> None:
        self.positions: list[Position] = []
        self.lost: list[str] = []

    def both(self) -> tuple[Callable[[Position], None], Callable[[str], None]]:
        return self.positions.append, self.lost.append


def test_arrival_jitter_does_not_reach_the_times() -> None:
    random = np.random.default_rng(1)
    clock, errors_s = SourceClock(latency_s=0.005), []
    for n in range(3000):
        true_s = 100.0 + n / 100
        source_s = (true_s - 90.0) * (1 + 300e-6)
        arrived_s = true_s + 0.005 + random.exponential(0.004)
        at_s = clock.loop_s(source_s, arrived_s)
        assert at_s is not None and at_s <= arrived_s
        errors_s.append(at_s - true_s)
    late = np.array(errors_s[500:])
    assert np.abs(late).max() < 0.0015
    steps_s = np.diff(late)
    assert np.percentile(np.abs(steps_s), 99) < 0.0002
    assert clock.restarts == 0


@pytest.mark.parametrize("busy_s", [0.1, 0.3])
def test_times_ascend_although_a_busy_computer_takes_messages_late(busy_s: float) -> None:
    random = np.random.default_rng(2)
    clock, times_s, arrived_s = SourceClock(latency_s=0.005), [], 0.0
    for n in range(3000):
        true_s = 100.0 + n / 100
        late_s = busy_s * random.exponential() if n % 40 == 0 else 0.0
        arrived_s = max(arrived_s, true_s + 0.005 + late_s)
        times_s.append(clock.loop_s((true_s - 90.0) * (1 + 300e-6), arrived_s))
    told_s = np.array([at_s for at_s in times_s if at_s is not None])
    assert np.diff(told_s).min() > 0.0
    assert len(told_s) > 0.98 * len(times_s)
    assert clock.restarts == 0


def test_times_that_run_back_are_refused_and_a_restart_is_not() -> None:
    clock = SourceClock(0.0)
    assert clock.loop_s(5.0, 10.0) == 10.0
    assert clock.loop_s(5.0, 10.01) is None
    assert clock.loop_s(4.99, 10.02) is None
    assert clock.loop_s(5.1, 10.1) == pytest.approx(10.1)
    assert clock.loop_s(0.0, 10.2) == pytest.approx(10.2)
    assert clock.restarts == 1
    assert clock.loop_s(1000.0, 10.3) == pytest.approx(10.3)
    assert clock.restarts == 2
    # A stalled link is no restart: its messages are late, never early.
    assert clock.loop_s(1000.1, 20.0) == pytest.approx(10.4)
    assert clock.restarts == 2


async def test_a_serial_tracker_delivers_counts_and_is_lost_with_its_port(
    loop: JumpingLoop,
) -> None:
    link, listener = MemoryLink(loop, "/dev/tracker"), TrackerListener()
    tracker = SerialTracker(link, loop, latency_s=0.01)
    tracker.open(*listener.both())
    with pytest.raises(LinkLost, match="open already"):
        tracker.open(*listener.both())
    link.say(b"9,9,9\n", 0.1)
    for n in range(1, 6):
        valid = b"" if n < 5 else b",0"
        link.say(f"{1000 + 10 * n},{n},0,-1".encode() + valid + b"\n", 0.1 + n / 100)
    link.say(b"1020,7,7,7\nrubbish\n", 0.2)
    await asyncio.sleep(0.5)
    assert [p.x_mm for p in listener.positions] == [1, 2, 3, 4, 5]
    assert [p.valid for p in listener.positions] == [True] * 4 + [False]
    expected_s = [0.1 + n / 100 for n in range(5)]
    assert [p.at_s for p in listener.positions] == pytest.approx(expected_s)
    counters = tracker.counters
    assert (counters.positions, counters.invalid) == (5, 1)
    assert (counters.out_of_order, counters.malformed) == (1, 1)
    link.unplug()
    assert listener.lost == ["/dev/tracker: the port vanished"]
    assert not tracker.is_open
    with pytest.raises(LinkLost, match="no such port"):
        tracker.open(*listener.both())
    assert not tracker.is_open
    link.plugged = True
    tracker.open(*listener.both())
    tracker.close()
    tracker.close()


async def test_a_silent_tracker_is_lost_and_a_failing_consumer_ends_it(loop: JumpingLoop) -> None:
    link, listener = MemoryLink(loop, "/dev/tracker"), TrackerListener()
    tracker = SerialTracker(link, loop)
    tracker.open(*listener.both())
    await asyncio.sleep(3.0)
    assert len(listener.lost) == 1
    assert "sent no position for 2 s: check that it is on" in listener.lost[0]
    assert not link.is_open
    listener.lost.clear()

    def fails(position: Position) -> None:
        raise KeyError("oops")

    tracker.open(fails, listener.lost.append)
    link.say(b"\n1,2,3,4\n2,2,3,4\n")
    await asyncio.sleep(0.1)
    assert listener.lost == [
        "tracker /dev/tracker: a consumer of positions failed: KeyError('oops')"
    ]


def test_udp_listens_on_loopback_only() -> None:
    async def main() -> None:
        loop, listener = asyncio.get_running_loop(), TrackerListener()
        tracker, came = UdpTracker(0, loop), asyncio.Event()

        def take(position: Position) -> None:
            listener.positions.append(position)
            came.set()

        tracker.open(take, listener.lost.append)
        assert tracker._socket is not None
        assert tracker._socket.getsockname() == ("127.0.0.1", tracker.port)
        with pytest.raises(LinkLost, match=r"cannot listen on 127\.0\.0\.1: close the program"):
            UdpTracker(tracker.port, loop).open(*listener.both())
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"1,2", ("127.0.0.1", tracker.port))
            sender.sendto(b"1,20,3,4,5", ("127.0.0.1", tracker.port))
            await asyncio.wait_for(came.wait(), 60)
        assert listener.positions[0][1:] == (3, 4, 5, True)
        assert tracker.counters.malformed == 1
        tracker.close()

    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        runner.run(main())


async def test_datagrams_from_elsewhere_malformed_late_and_lost_are_counted(
    loop: JumpingLoop,
) -> None:
    listener = TrackerListener()
    tracker = UdpTracker(0, loop)
    tracker.open(*listener.both())
    tracker.take(b"1,10,3,4,5", "10.0.0.7", 0.01)
    for number, time_ms in [(1, 10), (2, 20), (2, 25), (5, 30), (4, 28), (6, 29), (7, 40)]:
        tracker.take(f"{number},{time_ms},3,4,5".encode(), "127.0.0.1", time_ms / 1000)
    tracker.take(b"hello", "127.0.0.1", 0.05)
    tracker.take(b"1,100000,3,4,5", "127.0.0.1", 0.06)
    tracker.take(b"2,100010,3,4,5", "127.0.0.1", 0.07)
    counters = tracker.counters
    assert (counters.foreign, counters.malformed, counters.clock_restarts) == (1, 1, 1)
    assert (counters.positions, counters.out_of_order, counters.lost) == (6, 3, 3)
    tracker.close()


def track(seconds: float = 1.0) -> list[Position]:
    return [
        Position(50 + n / 100, float(n), 0.0, 0.0, n % 7 != 0) for n in range(round(seconds * 100))
    ]


async def test_a_recorded_track_plays_in_the_loops_time_and_ends(loop: JumpingLoop) -> None:
    await asyncio.sleep(3.0)
    listener, arrivals_s = TrackerListener(), []
    tracker = RecordedTrack(track(), loop, "track a.csv")

    def take(position: Position) -> None:
        listener.positions.append(position)
        arrivals_s.append(loop.time())

    tracker.open(take, listener.lost.append)
    await asyncio.sleep(0.5)
    assert len(listener.positions) in (50, 51)
    await asyncio.sleep(1.0)
    assert [p.x_mm for p in listener.positions] == list(range(100))
    assert [p.at_s for p in listener.positions] == pytest.approx(arrivals_s)
    assert listener.positions[10].at_s == pytest.approx(3.1)
    assert listener.lost == ["track a.csv: the recorded track has ended"]
    assert tracker.counters.invalid == 15
    tracker.open(take, listener.lost.append)
    tracker.close()
    await asyncio.sleep(1.0)
    assert len(listener.positions) == 100


def test_a_track_is_read_from_a_file_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "track.csv"
    path.write_text("time_ms,x,y,z,valid\n0,1,2,3,1\n10,2,2,3,0\n")
    assert read_track(path) == [Position(0, 1, 2, 3, True), Position(0.01, 2, 2, 3, False)]
    path.write_text("0,1,2,3\n10,2,2\n")
    with pytest.raises(WrongUse, match="position 2 is not time_ms,x,y,z"):
        read_track(path)
    with pytest.raises(WrongUse, match=r"cannot read .*none\.csv"):
        read_track(tmp_path / "none.csv")
    loop = asyncio.new_event_loop()
    for bad in ([], [track()[1], track()[0]]):
        with pytest.raises(WrongUse, match="a track needs positions with ascending times"):
            RecordedTrack(bad, loop)
    loop.close()


def test_an_endless_track_is_refused(tmp_path: Path) -> None:
    track, pipe = tmp_path / "track.csv", tmp_path / "pipe"
    with track.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(WrongUse, match=r"track\.csv is larger than 67,108,864 bytes"):
        read_track(track)
    track.write_bytes(b"1,2,3,4\n" * 500_001)
    with pytest.raises(WrongUse, match="a track has at most 500,000 lines"):
        read_track(track)
    os.mkfifo(pipe)
    with pytest.raises(WrongUse, match="it is a pipe, not a file"):
        read_track(pipe)


def test_one_line_of_text_opens_any_tracker(tmp_path: Path) -> None:
    loop = asyncio.new_event_loop()
    path = tmp_path / "track.csv"
    path.write_text("0,1,2,3\n10,2,2,3\n")
    names = {
        "serial:/dev/ttyACM1?baud=921600&latency_ms=8": "tracker /dev/ttyACM1",
        "serial:tcp://127.0.0.1:5030": "tracker tcp://127.0.0.1:5030",
        "udp:5040": "tracker udp:5040",
        f"file:{path}": "track track.csv",
        "imu:/dev/ttyACM2": "imu /dev/ttyACM2",
        "vive": "vive",
        "vive:LHR-1": "vive LHR-1",
    }
    for spec, name in names.items():
        assert open_tracker(spec, loop).name == name
    for spec in ("", "udp:", "udp:70000", "udp:x", "serial:", "usb:1", "imu:"):
        with pytest.raises(WrongUse, match="names no tracker: write serial:PORT, udp:PORT"):
            open_tracker(spec, loop)
    for query in ("latency=8", "latency_ms=x", "latency_ms=100", "baud=1"):
        with pytest.raises(WrongUse, match=r"options are|must be a number from"):
            open_tracker(f"serial:/dev/x?{query}", loop)
    loop.close()
