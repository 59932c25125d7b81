"""Numbers of the taxel board's frames, and of the state and the counts of their decoder."""

from __future__ import annotations

IDENTITY, DATA, STATUS, SELF_TEST = 0x10, 0x11, 0x12, 0x13
STATUS_BODY, IDENTITY_BODY, SELF_TEST_BODY = 26, 20, 18
CONTROLS = ((STATUS, STATUS_BODY), (IDENTITY, IDENTITY_BODY), (SELF_TEST, SELF_TEST_BODY))
READING_BITS = 10
EDGE_BITS = 4
READINGS_AT = 4
"""Offset of the readings in the body of a data frame; behind them are the edges."""
OVERHEAD = 5
"""Bytes that CRC-32 and COBS add to a body, without the closing zero."""

# Indices into the decoder's state, int64.
REFERENCE, LAST, BOOT_COUNT, DROPS = 0, 1, 2, 3
SYNCHRONISED, DISCARDED, WAITING, PREVIOUS, WITNESS = 4, 5, 6, 7, 8
STATE_SIZE = 9
UNKNOWN = -1
JITTER = 50
"""Samples by which a status frame may lag behind the data frames around it."""
MAX_JUMP = 1000
"""Longest gap that a data frame alone can tell: it holds only 16 bits of the counter."""
LATE = 8
"""Samples of the boot before that may still come behind the news of a reboot."""

# Why data frames are dropped until a status comes: the stream has just been joined, or a data frame
# may be behind a reboot whose identity was lost.
JOINING, DOUBTING = 1, 2

# What a status or identity tells.
FRESH, REBOOTED, STALE = 0, 1, 2

# Indices into the counts of one call, int64.
N_ROWS, N_GAPS, N_CONTROLS, N_REBOOTS, REJECTED_FRAMES, REJECTED_BYTES, USED = 0, 1, 2, 3, 4, 5, 6
STALE_FRAMES = 7
COUNTS_SIZE = 8
