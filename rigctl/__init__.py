"""Drum, taxels and spikes: acquisition and analysis for a tactile texture rig.

For scripts and notebooks there are :func:`connect`, :func:`encode`, :func:`analyse` and
:func:`open_session`, and what they return and raise; see :mod:`rigctl.api`.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
__all__ = ["ConnectedRig", "RigctlError", "analyse", "connect", "encode", "open_session"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: a command needs few of them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("rigctl.errors" if name == "RigctlError" else "rigctl.api"), name)
