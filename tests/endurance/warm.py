"""Loads the program and its compiled kernels once, for processes that begin as copies of it."""

from rigctl.bench.virtual_rig import compile_kernels
from tests.endurance import sitting

compile_kernels()
__all__ = ["sitting"]
