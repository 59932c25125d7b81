"""Log the truth of a simulated world until the process is killed, and print the rows on disk.

``python -m tests.session.endless_truth FOLDER START_UTC``
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from rigctl.session.ground_truth import TruthRows, begin_log

ROWS = 700


def rows_from(first_ms: int, n_rows: int = ROWS) -> TruthRows:
    """Return rows whose values follow from their time."""
    at_ms = np.arange(first_ms, first_ms + n_rows)
    speed = (at_ms % 1000).astype(np.float32)
    return first_ms, speed, speed / 2, (at_ms // 50 % 2).astype(np.uint8)


def main() -> None:
    log = begin_log(Path(sys.argv[1]), (sys.argv[2], 0.0), 0)
    at_ms = 0
    while True:
        log.write(rows_from(at_ms))
        at_ms += ROWS
        print(f"rows {at_ms}", flush=True)


if __name__ == "__main__":
    main()
