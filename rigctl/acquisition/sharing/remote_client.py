"""A client of an engine on another computer, through a socket that SSH forwards."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from rigctl.acquisition.live_file import LiveFile, LiveLayout
from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.engine_files import EngineFile
from rigctl.acquisition.rpc.runtime_folder import ENGINE_FILE, LIVE, SOCKET
from rigctl.acquisition.sharing.sample_stream import append_samples
from rigctl.errors import LinkLost, WrongUse

FILE_LIMIT_BYTES = 1 << 16
KEPT_ROWS = (1 << 15, 1 << 13)
"""Of both rings: half a minute, as the engine keeps."""
CONNECTION_LOST = "the connection to the engine on the other computer is lost"
UNLINK = "-o StreamLocalBindUnlink=yes"
"""Lets ssh replace the socket that it leaves behind each time."""


class RemoteClient(EngineClient):
    """One connection to an engine whose memory is elsewhere.

    The engine streams its live data; they are kept in a file of this computer, which has the place
    of the engine's own in ``engine_file``. ``layout``: of its experiment.
    Raises LinkLost where nothing answers.
    """

    shares_memory = False

    def __init__(self, engine: EngineFile, layout: LiveLayout) -> None:
        self._layout = layout
        self._folder = tempfile.TemporaryDirectory(prefix="rigctl-remote-")
        path = Path(self._folder.name) / (engine.name + LIVE)
        self._file = LiveFile.create(path, layout, *KEPT_ROWS)
        try:
            super().__init__(replace(engine, live=str(path)))
            self.send("stream")
        except LinkLost as error:
            self._remove_file()
            raise LinkLost(
                f"nothing answers behind {engine.socket or f'port {engine.port}'}: the engine has "
                "ended there, or ssh no longer forwards: forward the socket again"
            ) from error
        except BaseException:
            self._remove_file()
            raise

    def _keep(self, message: dict[str, Any]) -> None:
        """Store samples as they come, whether or not somebody takes the messages."""
        if message.get("event") != "samples":
            super()._keep(message)
            return
        try:
            append_samples(self._file, self._layout, message.get("data") or {})
        except LinkLost as error:
            self._link_error = str(error)

    def _lost_text(self, why: str) -> str:
        return (
            f"{CONNECTION_LOST} ({why}): the rig may go on, and STOP does not reach it from here; "
            "forward the socket again and join, unless the engine has ended there"
        )

    def close(self) -> None:
        """Close the connection; the engine continues."""
        super().close()
        self._remove_file()

    def _remove_file(self) -> None:
        if self._folder.name and Path(self._folder.name).exists():
            self._file.close()
            self._folder.cleanup()


def read_remote_engine(path: Path) -> EngineFile:
    """Return an engine by a copy of its file, with the socket that SSH forwards beside the copy.

    Raises WrongUse where the file or the socket is not there.
    """
    engine = _read(path)
    beside = path.absolute().parent / (path.name.removesuffix(ENGINE_FILE) + SOCKET)
    if engine.socket and not beside.exists():
        raise WrongUse(
            f"{beside} is not there: forward the engine's socket to it with "
            f"ssh -N {UNLINK} -L {beside}:{engine.socket} HOST"
        )
    return replace(engine, socket=str(beside) if engine.socket else "", live="")


def _read(path: Path) -> EngineFile:
    try:
        with path.open("rb") as file:
            return msgspec.json.decode(file.read(FILE_LIMIT_BYTES), type=EngineFile)
    except OSError as error:
        raise WrongUse(
            f"{path} cannot be read ({error.strerror}): copy it from the rig's computer"
        ) from error
    except (ValueError, RecursionError) as error:
        raise WrongUse(
            f"{path} is no file of an engine: copy NAME{ENGINE_FILE} from the rig's computer"
        ) from error
