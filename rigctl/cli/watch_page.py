"""A watched session as a page in the browser: ``rigctl watch --http``.

The page has state, times, the newest trial's spikes and what was not good, and loads itself again.
It is made from each look; a browser gets the last one and can ask for nothing else.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from rigctl.cli.session_looks import Look, TrialRaster

LOOPBACK = "127.0.0.1"
RELOAD_S = 2
SHOWN_EVENTS = 20
ROW_PX, WIDTH_PX, GAP_PX = 12, 900, 10
HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'",
    "X-Content-Type-Options": "nosniff",
}
STYLE = """
:root { color-scheme: light dark; font: 16px/1.45 system-ui, sans-serif }
body { max-width: 60rem; margin: 1.5rem auto; padding: 0 1rem }
h1 { font-size: 1.3rem; overflow-wrap: anywhere } h2 { font-size: 1rem; margin-top: 1.5rem }
.doing { font-size: 1.15rem } .gone { color: light-dark(#b00020, #ff8a80); font-weight: 600 }
li { overflow-wrap: anywhere } svg { width: 100%; height: auto } path { stroke: currentColor }
text { fill: currentColor; font-size: 11px }
"""


def listen_address(shown: str, text: str) -> tuple[str, int]:
    """Return host and port of ``[HOST:]PORT``. Raises WrongUse for another text."""
    host, _, port = text.rpartition(":")
    if not port.isascii() or not port.isdecimal() or not 0 <= int(port) <= 65_535:
        raise WrongUse(f"{shown} {text!r} is no port: give one such as 8080, or 0.0.0.0:8080")
    return host.strip("[]") or LOOPBACK, int(port)


class WatchPage:
    """Serves the page in threads of its own while a ``with`` statement lasts.

    Port 0 is a free one; :attr:`address` has it. Raises WrongUse where the port cannot be had.
    """

    def __init__(self, at: tuple[str, int], session: Path) -> None:
        host, port = at
        self._session = session
        self._events: deque[str] = deque(maxlen=SHOWN_EVENTS)
        self._page = b""
        try:
            self._server = ThreadingHTTPServer((host, port), self._handler())
        except OSError as error:
            raise WrongUse(
                f"{host}:{port} cannot be had ({error.strerror}): choose another port"
            ) from error
        self._server.daemon_threads = False
        shown = "localhost" if host == LOOPBACK else host
        self.address = f"http://{shown}:{self._server.server_address[1]}"
        self._is_for_all = host != LOOPBACK
        self._thread = threading.Thread(target=self._server.serve_forever, name="page")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def show(self, look: Look) -> None:
        """Show what a look has found."""
        self._events.extend(text for text in look.news if text)
        self._page = page_html(self._session, look, list(self._events)[::-1]).encode()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        page = self

        class Handler(BaseHTTPRequestHandler):
            """Answers GET of the page; the server's base refuses every other method."""

            timeout = 10
            server_version, sys_version = "rigctl", ""

            def do_GET(self) -> None:
                """Send the page as of the last look."""
                if not page.may_read(self.headers.get("Host", "")):
                    return self.send_error(403, "this page is for this computer only")
                if self.path.partition("?")[0] != "/":
                    return self.send_error(404, "there is one page: /")
                body = page.body
                self.send_response(200)
                for name, value in HEADERS.items():
                    self.send_header(name, value)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                with suppress(ConnectionError):  # the browser was closed meanwhile
                    self.wfile.write(body)
                return None

            def log_message(self, *_: Any) -> None:
                """Say nothing: the terminal shows the session."""

        return Handler

    @property
    def body(self) -> bytes:
        """The page as of the last look."""
        return self._page

    def may_read(self, host: str) -> bool:
        """Return whether a request is for this page: another site's name may lead here, too."""
        name = host.rpartition(":")[0] or host
        return self._is_for_all or name in ("localhost", LOOPBACK)


def page_html(session: Path, look: Look, events: Sequence[str]) -> str:
    """Return the page of a look; ``events`` with the newest first."""
    name, state = escape(session.absolute().name), _state(look)
    items = "".join(f"<li>{escape(part)}</li>" for part in look.line.split("; "))
    raster = "" if look.raster is None else raster_svg(look.raster)
    origin = "SIMULATED: " if look.simulated else ""
    title = "" if look.raster is None else escape(origin + look.raster.title.rstrip(":"))
    parts = [
        f"<h1>{name}</h1>{state}<ul>{items}</ul><h2>{title}</h2>{raster}",
        _listed("Repeated, given up or in quarantine", look.not_good[::-1]),
        _listed("Events, the newest first", events),
        "<p><small>rigctl watch only looks: nothing here reaches the rig.</small></p>",
    ]
    goes_on = not (look.has_ended or look.is_gone)
    reload = f'<meta http-equiv="refresh" content="{RELOAD_S}">' if goes_on else ""
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width">{reload}'
    body = "".join(parts)
    return (
        f'<!doctype html><html lang="en"><head>{head}<title>{name}</title>'
        f"<style>{STYLE}</style></head><body>{body}</body></html>"
    )


def _state(look: Look) -> str:
    if look.is_gone:
        return '<p class="gone">the program that recorded it is gone</p>'
    words = "the session is closed" if look.has_ended else look.doing or "no engine here tells more"
    return f'<p class="doing">{escape(words)}</p>'


def _listed(title: str, texts: Sequence[str]) -> str:
    if not texts:
        return ""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<h2>{title}</h2><ul>{items}</ul>"


def raster_svg(raster: TrialRaster) -> str:
    """Return the spikes of a trial as a drawing, a row for each train, time from left to right."""
    top, drawn = 0, []
    for name, trains in raster.channels:
        drawn.append(f'<text x="0" y="{top + ROW_PX}">{escape(name)}</text>')
        for train in trains:
            drawn.append(f'<path d="{_ticks(train, top, raster.n_samples)}"/>')
            top += ROW_PX
        top += GAP_PX
    drawn.append(f'<text x="{WIDTH_PX}" y="{top}" text-anchor="end">{raster.n_samples} ms</text>')
    label = escape(raster.title, quote=True)
    box = f'viewBox="0 0 {WIDTH_PX} {top}" role="img" aria-label="{label}"'
    return f"<svg {box}>{''.join(drawn)}</svg>"


def _ticks(train: NDArray[np.int32], top: int, n_samples: int) -> str:
    """Return a stroke for each pixel with a spike, behind the channel's name."""
    left = 30
    at = np.unique(left + train.astype(np.int64) * (WIDTH_PX - left) // n_samples)
    return "".join(f"M{x} {top + 2}v{ROW_PX - 4}" for x in at.tolist())
