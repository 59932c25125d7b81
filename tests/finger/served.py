"""The virtual finger behind the ports of ``rigctl serve --finger``, and its person's line."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

DEADLINE_S = 60.0


@dataclass
class ServedFinger:
    """Addresses of a served finger, and the open line to its person."""

    finger: str
    tracker: str
    terminal: str
    udp_port: int
    line: TextIO

    def tell(self, command: str) -> str:
        """Send the person a command and return the answer."""
        self.line.write(f"{command}\n")
        self.line.flush()
        return self.line.readline().strip()

    def write_rig(self, folder: Path, source: str, frame: str = "plate-frame.toml") -> Path:
        """Write a ``finger.toml`` for this finger."""
        rig = folder / "finger.toml"
        rig.write_text(
            f'[about]\nname = "served finger"\n[finger]\nport = "tcp://{self.finger}"\n'
            f'[tracker]\nsource = "{source}"\nframe = "{frame}"\n'
        )
        return rig


def free_udp_port() -> int:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serve_finger() -> Iterator[ServedFinger]:
    """Serve a finger by the command line; it ends well on SIGTERM."""
    port = free_udp_port()
    command = [sys.executable, "-m", "rigctl", "serve", "--finger", "--json", "--udp", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        served = json.loads(process.stdout.readline())
        host, person_port = served["person"]["tcp"].split(":")
        with (
            closing(socket.create_connection((host, int(person_port)), DEADLINE_S)) as connection,
            connection.makefile("rw") as line,
        ):
            yield ServedFinger(
                served["finger"]["tcp"],
                served["tracker"]["tcp"],
                served["tracker"]["pty"],
                port,
                line,
            )
        process.send_signal(signal.SIGTERM)
        assert process.wait(DEADLINE_S) == 0
