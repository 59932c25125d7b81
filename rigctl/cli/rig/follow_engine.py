"""``rigctl follow-engine``: the process that follows a session. The window starts it."""

from __future__ import annotations

import argparse
import asyncio
from contextlib import closing
from pathlib import Path

from rigctl.acquisition.follow.awaited_session import (
    AwaitedSession,
    follows_finger,
    is_awaited,
)
from rigctl.acquisition.follow.follow_engine import (
    FollowCommands,
    FollowedSession,
    FollowEngine,
)
from rigctl.acquisition.follow.followed_drum import FollowedDrum
from rigctl.acquisition.follow.growing_session import GrowingSession
from rigctl.acquisition.follow.states import NOTHING_YET
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.live_file import LiveFileWriter
from rigctl.acquisition.rpc.engine_files import FOLLOWED
from rigctl.acquisition.rpc.messages import EngineStatus
from rigctl.cli.options.arguments import path_or_name, whole_number
from rigctl.cli.rig.engine_process import EngineProcess
from rigctl.errors import WrongUse
from rigctl.finger_values import N_FINGER_TAXELS
from rigctl.protocol.plan import MAX_SEED
from rigctl.realtime.follow.followed_finger import FollowedFinger
from rigctl.realtime.follow.growing_finger_session import GrowingFingerSession
from rigctl.realtime.live_file import FingerLiveWriter
from rigctl.realtime.messages import FingerEngineStatus
from rigctl.session.session_reader import SessionReader
from rigctl.values import N_TAXELS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command; those of every engine that have no use here, too."""
    parser.add_argument("--rig", type=path_or_name("--rig"), required=True)
    parser.add_argument("--name", default=None)
    parser.add_argument("--seed", type=whole_number("--seed", 0, MAX_SEED), default=0)
    parser.add_argument("--paced", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Open the session or await it, announce the follower, wait for its first client, serve."""
    path = Path(args.rig)
    return _follow_finger(args, path) if follows_finger(path) else _follow_drum(args, path)


def _follow_drum(args: argparse.Namespace, path: Path) -> int:
    drum = None if is_awaited(path) else _open_drum(path)
    process = EngineProcess(args.name, args.rig, FOLLOWED)
    with closing(LiveWriter(process.live_path)) as live:
        if drum is not None:
            return _serve(process, FollowedDrum(drum, live), live)
        waiting = EngineStatus(rig=f"following {path.name}", state_words=NOTHING_YET)
        awaited = AwaitedSession(path, lambda: FollowedDrum(_open_drum(path), live), waiting)
        return _serve(process, awaited, live)


def _follow_finger(args: argparse.Namespace, path: Path) -> int:
    finger = None if is_awaited(path) else _open_finger(path)
    process = EngineProcess(args.name, args.rig, FOLLOWED)
    with closing(FingerLiveWriter(process.live_path)) as live:
        if finger is not None:
            return _serve(process, FollowedFinger(finger, live), live)
        waiting = FingerEngineStatus(rig=f"following {path.name}")
        awaited = AwaitedSession(path, lambda: FollowedFinger(_open_finger(path), live), waiting)
        return _serve(process, awaited, live)


def _open_drum(path: Path) -> GrowingSession:
    drum = GrowingSession(path)
    _check_taxels(drum.session, N_TAXELS)
    return drum


def _open_finger(path: Path) -> GrowingFingerSession:
    finger = GrowingFingerSession(path)
    _check_taxels(finger.session, N_FINGER_TAXELS)
    return finger


def _serve(process: EngineProcess, followed: FollowedSession, live: LiveFileWriter) -> int:
    with closing(asyncio.SelectorEventLoop()) as loop:
        engine = FollowEngine(loop, followed, live)
        return process.serve(engine, FollowCommands(engine).handle, None)


def _check_taxels(session: SessionReader, shown: int) -> None:
    """Raise WrongUse for a session that the live views cannot show."""
    if (n_taxels := session.header.n_taxels) != shown:
        raise WrongUse(
            f"{session.path} has {n_taxels} taxels, but live views have {shown}: open it in the "
            "panel Analysis"
        )
