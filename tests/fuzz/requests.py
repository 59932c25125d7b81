"""Mutated requests to the engines of both experiments, each on its simulated rig in this process.

A request is answered or refused in a sentence: nothing else may come out of a command, no request
may end the engine but ``shutdown``, and none may hold its loop.
"""

from __future__ import annotations

import asyncio
import json
import signal
import traceback
from collections.abc import Awaitable, Callable
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.rpc.messages import decode_request, encode_message
from rigctl.errors import RigctlError
from rigctl.finger.commands import FingerCommands
from tests.engine.engine_harness import EngineHarness, open_harness
from tests.finger.harness import FingerHarness, open_finger_harness
from tests.fuzz.guard import SENTENCE_LETTERS, Attempt, Finding, TooLong, raise_too_long

LIMIT_S = 1.0
"""Processor time between two turns of the loop, above what a request to start a run may take."""
START_S = 5.0
TURNS = 5
WAIT_EVERY = 25
ODD: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 0.5, 1e308, float("nan"), float("inf"), -float("inf")),
    *(2**31, 2**53, 2**63, 2**64, -(2**63), 10**400, "", "é", "\x1b[2J", "a\0b", "\ud800"),
    *("x" * 300, "x" * 20_000, "../x", "../../x", [], {}, [[]], [1, "a", None], {"a": 1}),
    *({"": {}}, [[[[[]]]]], "1", "nan", "ok", "abort", "A", "quick", "normalise", "__class__"),
)
PROTOCOL = 'name = "t"\ntextures = ["A"]\nspeeds_mm_s = [120]\nforces_g = [500]\nrepeats = 1\n'
FINGER_PROTOCOL = """name = "t"
textures = ["A"]
profiles = ["medium"]
[stages]
normalise = 1
train = 0
calibrate = 0
run = 0
"""
SHARED: tuple[tuple[str, dict[str, Any]], ...] = (
    *(("status", {}), ("pause", {}), ("resume", {}), ("abort", {}), ("stop", {})),
    *(
        ("answer", {"prompt_id": 1, "answer": "ok"}),
        ("inject", {"fault": "drop_frames", "count": 3}),
    ),
    ("lsl", {"scope": "off"}),
)
DRUM: tuple[tuple[str, dict[str, Any]], ...] = (
    *SHARED,
    *((name, {}) for name in ("arm", "disarm", "tare", "home", "approach", "run", "retract")),
    *(("jog", {"mm": 5.0}), ("set", {"speed_mm_s": 80.0}), ("set", {"force_g": 300.0})),
    *(("set", {"travel_mm": 20.0, "run_in_mm": 10.0}), ("clear_fault", {}), ("test_taxels", {})),
    *(("calibrate_loadcell", {"mass_g": 0.0}), ("calibrate_loadcell", {"mass_g": 200.0})),
    *(("calibrate_force", {"force_g": 300.0}), ("calibrate_imbalance", {})),
    ("axis", {"height_mm": 1.0}),
    *(("calibrate_wiring", {}), ("repeat_press", {}), ("cancel_calibration", {})),
    *(("forget_mass", {"mass_g": 200.0}), ("save_calibration", {"part": "loadcell"})),
    ("discard_calibration", {"part": "wiring"}),
    *((name, {}) for name in ("setup_open", "setup_begin_again", "setup_commission")),
    *(("setup_check", {"part": part}) for part in ("ports", "cell")),
    *(("setup_answer", {"question_id": 1, "text": "1"}), ("setup_keep", {"part": "wires"})),
    *(("plate", {"texture": "L"}), ("calibrate_range", {"force_g": 300.0})),
    *(("record", {"out": "hand", "note": "By hand."}), ("end_record", {})),
    *(("note", {"text": "The edge is worn."}), ("repeat", {"trial_id": 0})),
    ("repeat", {"trial_id": 1, "text": "The plate was loose."}),
    (
        "end_condition",
        {"texture": "A", "speed_mm_s": 100.0, "force_g": 300.0, "trials": 5, "mean_hz": 20.0}
        | {"half_width_hz": 1.0},
    ),
    *(("start", {"protocol": "drum.toml", "out": "new", "seed": 3, "yes": True}),) * 2,
    *(
        ("enqueue", {"protocol": "drum.toml", "out": "queued", "yes": True}),
        ("skip", {"trial_id": 1}),
    ),
    *(
        ("move_queued", {"number": 1, "places": 1}),
        ("dequeue", {"number": 1}),
        ("start_queued", {}),
    ),
    ("start", {"resume": "new", "yes": True, "operator": "Ada", "sensor": "S 3", "notes": "New."}),
)
FINGER: tuple[tuple[str, dict[str, Any]], ...] = (
    *SHARED,
    ("shown", {"scan": 1, "sent_s": 1.0}),
    *(("start", {"stages": ["normalise"], "protocol": "finger.toml", "out": "new", "seed": 1}),)
    * 2,
    ("start", {"stages": ["run"], "model": "none.h5", "coverage": 0.9, "error_rate": 0.1}),
    ("start", {"resume": "new", "yes": True}),
)

Handle = Callable[[str, dict[str, Any]], Awaitable[dict[str, Any]]]
Harness = EngineHarness | FingerHarness


@dataclass
class Requests:
    """Sends mutated requests of one experiment to one engine."""

    valid: tuple[tuple[str, dict[str, Any]], ...]
    random: Random
    findings: list[Finding] = field(default_factory=list)
    answered: int = 0
    refused: int = 0
    _pending: set[asyncio.Task[None]] = field(default_factory=set)

    async def play(self, harness: Harness, handle: Handle, count: int) -> None:
        """Send ``count`` requests, many of them while others are under way."""
        for number in range(count):
            line = self.line(number)
            ready = harness.engine.is_ready and not harness.engine._shutdown_requested.is_set()
            if not ready:
                text = f"the engine ended before {line[:300]!r}: {harness.events[-3:]}"
                self.findings.append(Finding("ended", "engine", text))
                return
            await self._send(line, handle)
            if number % WAIT_EVERY == 0:
                await asyncio.sleep(0.05)
            harness.events[:-20] = []
        for task in self._pending:
            task.cancel()
        await asyncio.gather(*self._pending, return_exceptions=True)

    def line(self, number: int) -> bytes:
        """Return the bytes of one request: a whole one, or one that is damaged in some way."""
        random = self.random
        command, args = random.choice(self.valid)
        message: dict[str, Any] = {"id": number, "command": command, "args": dict(args)}
        if random.random() < 0.25:
            if "out" in args:
                message["args"]["out"] = f"run{number}"
            return json.dumps(message).encode()
        for _ in range(random.choice((1, 1, 2, 3))):
            self._damage(message)
        line = json.dumps(message).encode(errors="surrogatepass")
        if random.random() < 0.2:
            line = self._damage_bytes(bytearray(line))
        return line

    def _damage(self, message: dict[str, Any]) -> None:
        random, args = self.random, message.get("args")
        odd = deepcopy(random.choice(ODD))  # or later damage would put it into itself
        kind = random.randrange(7)
        if kind == 0:
            message[random.choice(("command", "args", "id", "extra"))] = odd
        elif kind == 1:
            message.pop(random.choice(list(message)), None)
        elif kind == 2:
            message["command"] = random.choice((*dict(DRUM), *dict(FINGER)))
        elif not isinstance(args, dict):
            message["args"] = {"texture": odd}
        elif kind == 3 and args:
            args.pop(random.choice(list(args)))
        elif kind == 4 or not args:
            names = ("mm", "texture", "seconds", "protocol", "out", "seed", "stages", "x", "self")
            args[random.choice((*names, "\x1b", "é", "", "fault", "prompt_id"))] = odd
        else:
            args[random.choice(list(args))] = odd
        if message.get("command") == "shutdown":
            del message["command"]

    def _damage_bytes(self, data: bytearray) -> bytes:
        random, at = self.random, self.random.randrange(len(data) + 1)
        piece = random.choice((b"[" * 5000, b'{"a":' * 5000, b"\xff", b"\0", b'"', b"9" * 5000))
        if random.random() < 0.5:
            data[at:at] = piece
        else:
            del data[at : at + random.choice((1, 5, 50))]
        return bytes(data).replace(b"\n", b" ")

    async def _send(self, line: bytes, handle: Handle) -> None:
        limit_s = START_S if b"start" in line else LIMIT_S
        signal.setitimer(signal.ITIMER_PROF, limit_s)
        task = asyncio.get_running_loop().create_task(self._answer(line, handle))
        self._pending.add(task)
        task.add_done_callback(self._pending.discard)
        for _ in range(TURNS):
            await asyncio.sleep(0)
        signal.setitimer(signal.ITIMER_PROF, 0)

    async def _answer(self, line: bytes, handle: Handle) -> None:
        """Answer as the server does; keep what is no answer."""
        with Attempt() as attempt:
            request = decode_request(line)
            reply = await handle(request.command, request.args)
            encode_message({"reply": request.id, "ok": True, "result": reply})
            self.answered += 1
        if isinstance(attempt.error, RigctlError):
            self.refused += 1
            self._judge_sentence(line, str(attempt.error))
        elif attempt.error is not None:
            self._keep(line, attempt.error)

    def _judge_sentence(self, line: bytes, text: str) -> None:
        if not text or "\n" in text or len(text) > SENTENCE_LETTERS:
            found = Finding("sentence", f"{text[:40]!r}", f"{line[:300]!r}: {text[:500]!r}")
            self.findings.append(found)

    def _keep(self, line: bytes, error: BaseException) -> None:
        failure = "hang" if isinstance(error, TooLong) else "traceback"
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "/rigctl/" in f.filename]
        place = f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "nowhere"
        details = "".join(traceback.format_exception(error))[-3000:]
        text = f"{line[:500]!r}\n{details}"
        self.findings.append(Finding(failure, f"{type(error).__name__} {place}", text))


def play_drum(folder: Path, seed: int, count: int) -> Requests:
    """Send requests to an engine of the drum that works in this folder."""
    (folder / "drum.toml").write_text(PROTOCOL)
    signal.signal(signal.SIGPROF, raise_too_long)
    requests = Requests(DRUM, Random(f"{seed} drum"))

    async def scenario(harness: EngineHarness) -> None:
        await requests.play(harness, DrumCommands(harness.engine).handle, count)

    with open_harness(folder, seed % 1000) as harness:
        harness.run(scenario)
    return requests


def play_finger(folder: Path, seed: int, count: int) -> Requests:
    """Send requests to an engine of the finger that works in this folder."""
    (folder / "finger.toml").write_text(FINGER_PROTOCOL)
    signal.signal(signal.SIGPROF, raise_too_long)
    requests = Requests(FINGER, Random(f"{seed} finger"))

    async def scenario(harness: FingerHarness) -> None:
        await requests.play(harness, FingerCommands(harness.engine).handle, count)

    with open_finger_harness(folder, seed % 1000) as harness:
        harness.run(scenario)
    return requests


PLAYERS = {"drum-requests": play_drum, "finger-requests": play_finger}
