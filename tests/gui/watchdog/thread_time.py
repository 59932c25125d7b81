"""What a thread of this process did, as Linux counts it."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import NamedTuple


class ThreadState(NamedTuple):
    """Whether a thread waits, how often it began to wait, and its time on a processor.

    A thread that is ready but has no processor does not wait.
    """

    is_asleep: bool
    waits: int
    worked_ns: int

    @classmethod
    def of(cls, native_id: int) -> ThreadState:
        """Return the state of a thread of this process."""
        task = Path(f"/proc/self/task/{native_id}")
        lines = (task / "status").read_text(encoding="utf-8").splitlines()
        fields = dict(line.split(":", 1) for line in lines)
        worked_ns = int((task / "schedstat").read_text(encoding="ascii").split()[0])
        waits = int(fields["voluntary_ctxt_switches"])
        return cls(fields["State"].split()[0] in "SD", waits, worked_ns)

    def slept_since(self, before: ThreadState) -> bool:
        """Return whether the thread waited without a break since an earlier state."""
        return self.is_asleep and before.is_asleep and self.waits == before.waits


def others_without_processor_ns(*native_ids: int) -> int:
    """Return how long the other threads of this process have been ready without a processor."""
    delays_ns = 0
    for task in Path("/proc/self/task").iterdir():
        if int(task.name) not in native_ids:
            with suppress(OSError):  # a thread that has just ended
                delays_ns += int((task / "schedstat").read_text(encoding="ascii").split()[1])
    return delays_ns
