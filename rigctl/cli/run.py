"""Run a protocol into a session.

Run a protocol into a session. Exit code 0: every trial is committed, or left out by an early end
of its condition; 1: the run ended without some trials; 2: wrong use; 3: the rig or the disk failed;
130: interrupted. The session is whole in every case.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Generic, Protocol, TypeVar

from rigctl.cli import INTERRUPTED
from rigctl.cli.arguments import (
    a_path,
    about_options,
    add_about,
    add_lsl,
    add_option,
    add_seed,
    ask_own_fields,
    path_or_name,
)
from rigctl.cli.progress import Interrupts, ProgressLine, clock
from rigctl.cli.verify import print_missing, print_session
from rigctl.cli.world import add_wirings, add_world
from rigctl.config.rig_config import load_config
from rigctl.config.text_file import refuse_link_outside
from rigctl.engine.rpc.client import COMMAND_LINE, EngineClient, EngineRefusal, client_name
from rigctl.engine.rpc.messages import (
    EngineStatus,
    PromptStatus,
    RunStatus,
    as_dict,
    parse_status,
)
from rigctl.errors import WrongUse
from rigctl.session.layout import RIG_FILE
from rigctl.session.session import Session
from rigctl.session.session_reader import read_closing_digest

POLL_S = 0.1
TOLD_EVENTS = (
    *("early_end", "fault", "link", "pause", "resume", "message", "stop", "control"),
    *("late", "recovery", "awake", "unrecorded", "hook", "copy", "lsl", "stream"),
)
"""Events that the user reads while the run goes on."""
EXIT_CODES = {"aborted": INTERRUPTED, "failed": 3}
KEYS = (
    "p pause · r resume · k skip the trial · a abort · c clear a fault · t take control · "
    "each with Enter"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser,
        "protocol",
        path_or_name,
        "PROTOCOL",
        "a file, or the name of a built-in protocol",
        nargs="?",
    )
    add_option(
        parser,
        "--rig",
        path_or_name,
        "RIG",
        "virtual, firmware, or a rig.toml (default: that of the session, else virtual)",
    )
    add_world(parser)
    add_wirings(parser)
    add_option(
        parser, "--out", a_path, "DIR", "folder of the new session (default: sessions/TIME-NAME)"
    )
    add_option(parser, "--resume", a_path, "DIR", "continue a session")
    add_seed(parser, "seed of the trial order and of a simulated rig")
    add_about(parser.add_argument_group("kept in the session, shown by rigctl info"))
    add_lsl(parser)
    parser.add_argument("--yes", action="store_true", help="change simulated plates without asking")
    parser.add_argument(
        "--paced", action="store_true", help="run simulated time at the speed of real time"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON line at the end")


def run(args: argparse.Namespace) -> int:
    """Start an engine, let it run the protocol, and watch the run to its end."""
    if (args.protocol is None) == (args.resume is None):
        raise WrongUse("give either a protocol, or --resume with a session")
    if args.resume is not None:
        print_missing(Path(args.resume))
    rig = _rig(args)
    if rig.endswith(".toml"):
        ask_own_fields(args, load_config(Path(rig)).about.ask)
    client = EngineClient.start(
        rig, paced=args.paced, seed=args.seed or 0, run=_engine_arguments(args)
    )
    send_lsl(client, args)
    ended = watch_run(client, ProgressLine(sys.stderr, quiet=args.json))
    _report(ended, args.json)
    if ended.state == "done":
        return 0 if ended.is_complete else 1
    return EXIT_CODES[ended.state]


def send_lsl(client: EngineClient, args: argparse.Namespace) -> None:
    """Let an engine stream from the start, where :func:`add_lsl` was answered."""
    if args.lsl:
        client.send("lsl", scope=args.lsl)


def watch_run(client: EngineClient, progress: ProgressLine) -> RunStatus:
    """Show a run on a drum to its end, shut the engine down, and return the run's last status."""
    return RunWatcher(client, progress, parse_status, _status_line).watch().run


class WatchedRun(Protocol):
    """A run as its watcher sees it."""

    @property
    def prompt(self) -> PromptStatus | None:
        """The question to answer."""

    @property
    def has_ended(self) -> bool:
        """Whether it is over."""


class WatchedStatus(Protocol):
    """A status message with a run."""

    @property
    def run(self) -> WatchedRun:
        """The run."""


_Status = TypeVar("_Status", bound=WatchedStatus)


class RunWatcher(Generic[_Status]):
    """Shows the progress of a run, and forwards typed commands and interrupts to the engine.

    ``parse`` reads a status message; ``format_status`` returns its line, given the wall time since
    the start. ``told``: kinds of events whose text is shown.
    """

    def __init__(
        self,
        client: EngineClient,
        progress: ProgressLine,
        parse: Callable[[Mapping[str, Any]], _Status],
        format_status: Callable[[_Status, float], str],
        told: Collection[str] = TOLD_EVENTS,
    ) -> None:
        self._told = told
        self._client = client
        self._progress = progress
        self._parse = parse
        self._format_status = format_status
        self._typed: SimpleQueue[str] = SimpleQueue()
        self._interrupts = Interrupts()
        self._prompt: PromptStatus | None = None
        self._no_more_answers = False

    def watch(self) -> _Status:
        """Watch until the run ends and leave the engine; return the last status.

        A signal ends the run, not this process. The engine ends unless a window uses it.
        """
        threading.Thread(target=self._read_keys, daemon=True, name="keys").start()
        with self._interrupts:
            try:
                self._client.send("introduce", name=client_name(COMMAND_LINE))
                ended = self._watch()
            except BaseException:
                with suppress(EngineRefusal):  # another client has control: the run is theirs
                    self._client.shut_down()
                raise
            self._client.leave()
            return ended

    def _watch(self) -> _Status:
        forwarded = 0
        while True:
            for message in self._client.wait(POLL_S):
                ended = self._take(message)
                if ended is not None:
                    self._progress.end()
                    return ended
            forwarded = self._forward_interrupts(forwarded)
            self._forward_keys()

    def _take(self, message: dict[str, Any]) -> _Status | None:
        if message.get("event") == "status":
            status = self._parse(message["data"])
            self._progress.show(self._format_status(status, self._progress.elapsed_s))
            self._note_prompt(status.run.prompt)
            return status if status.run.has_ended else None
        if message.get("event") in self._told:
            self._progress.say(message["text"])
        elif message.get("ok") is False:
            self._progress.say(str(message["error"]))
        return None

    def _note_prompt(self, prompt: PromptStatus | None) -> None:
        is_new, self._prompt = prompt != self._prompt, prompt
        if prompt is not None and is_new:
            self._progress.say(f"{prompt.text} [Enter, or a to abort]")
            if self._no_more_answers:
                self._end_unanswered()

    def _end_unanswered(self) -> None:
        self._progress.say(
            "there is no terminal to answer at, so the run ends; --yes answers for a simulated rig"
        )
        self._client.send("abort")

    def _forward_interrupts(self, forwarded: int) -> int:
        """Abort the run on the first interrupt, stop the rig on every further one."""
        if forwarded < self._interrupts.count:
            self._progress.say("stopping safely; the session is kept")
            self._client.send("abort" if forwarded == 0 else "stop")
        return self._interrupts.count

    def _forward_keys(self) -> None:
        try:
            key = self._typed.get_nowait()
        except Empty:
            return
        if key == "end":
            self._no_more_answers = True
            if self._prompt is not None:
                self._end_unanswered()
        elif self._prompt is not None and key in ("", "y", "yes", "ok"):
            self._client.send("answer", prompt_id=self._prompt.id, answer="ok")
        elif key in _COMMANDS:
            self._client.send(_COMMANDS[key])
        elif key:
            self._progress.say(KEYS)

    def _read_keys(self) -> None:
        """Read typed lines; runs in a thread, so that waiting for a line delays nothing."""
        for line in sys.stdin:
            self._typed.put(line.strip().lower())
        self._typed.put("end")


_COMMANDS = {
    "p": "pause",
    "r": "resume",
    "a": "abort",
    "c": "clear_fault",
    "k": "skip",
    "s": "stop",
    "t": "take_control",
}


def _status_line(status: EngineStatus, elapsed_wall_s: float) -> str:
    """Return the line for one status.

    The pace of the trials so far turns loop time into wall time; before the first there is none.
    """
    run = status.run
    parts = [f"{run.trials_committed}/{run.trials_planned} trials", run.state]
    if now := run.current:
        parts.append(f"{now.texture} {now.speed_mm_s:g} mm/s {now.force_g:g} g")
    if run.trials_ended_early:
        parts.append(f"{run.trials_ended_early} left out")
    if run.trials_rejected:
        parts.append(f"{run.trials_rejected} rejected")
    if run.eta_s is not None and run.trial_age_s is not None and run.elapsed_s > 0:
        parts.append(f"{clock(run.eta_s * elapsed_wall_s / run.elapsed_s)} left")
    parts.append(f"{status.recording.samples_on_disk} samples on disk")
    return " · ".join(parts)


def _rig(args: argparse.Namespace) -> str:
    """Return the named rig, or that of the session to resume, or the virtual one."""
    if args.rig is not None:
        return str(args.rig)
    if args.resume is None:
        return "virtual"
    with Session.open(Path(args.resume)) as session:
        kind, simulate = session.header.rig, session.config.ports.simulate
    if simulate:
        refuse_link_outside(Path(args.resume) / RIG_FILE)
        return str(Path(args.resume) / RIG_FILE)
    if kind not in ("virtual", "firmware"):
        raise WrongUse("this session was recorded on a real rig: name its rig.toml with --rig")
    return kind


def _engine_arguments(args: argparse.Namespace) -> list[str]:
    named = {
        "--world": args.world,
        "--protocol": args.protocol,
        "--out": args.out,
        "--resume": args.resume,
        "--order-seed": args.seed,
    }
    # In one word, or a name that begins with a dash would be an option.
    given = [f"{name}={value}" for name, value in named.items() if value is not None]
    given += [*about_options(args), *(f"--wire={name}" for name in args.wire)]
    return [*given, *(["--yes"] if args.yes else [])]


def _report(run: RunStatus, as_json: bool) -> None:
    if as_json:
        digest = read_closing_digest(Path(str(run.session)))
        summary = {"session": run.session, "digest": digest, **as_dict(run)}
        print(json.dumps(summary, default=as_dict))
        return
    print(
        f"{run.trials_committed} of {run.trials_planned} trials committed, "
        f"{run.trials_rejected} attempts rejected: {run.text}"
    )
    print_session(Path(str(run.session)))
