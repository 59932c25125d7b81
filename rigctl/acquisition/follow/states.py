"""Words for what a follower waits for, which the window shows in place of a state of the drum."""

NOTHING_YET = "nothing is recorded yet: the views begin with the first plate"
RECORDER_GONE = "the recorder is gone"
