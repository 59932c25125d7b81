"""The devices as a scientist names them: drum, taxels, finger, trackers, and their ports."""
