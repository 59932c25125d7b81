"""A Dask cluster of two processes and an empty one, in a process that a test may kill.

Prints one line of JSON when both run, and ends when its standard input closes.
"""

from __future__ import annotations

import json
import sys

from distributed import LocalCluster


def main() -> None:
    """Run both clusters until the standard input closes."""
    options = {"processes": True, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(n_workers=2, **options) as two, LocalCluster(n_workers=0, **options) as none:
        pids = [nanny.process.pid for nanny in two.workers.values()]
        addresses = two.scheduler_address, none.scheduler_address
        print(json.dumps({"two": addresses[0], "none": addresses[1], "pids": pids}), flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
