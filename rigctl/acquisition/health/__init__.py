"""Checks of boards, disk and heartbeat while the engine runs."""
