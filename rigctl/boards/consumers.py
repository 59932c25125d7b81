"""The consumers of a device's stream: none of them can stop the others or the reading."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, ParamSpec

Values = ParamSpec("Values")


class Consumers(Generic[Values]):
    """Callbacks that get each value in order; one that raises is reported and dropped."""

    def __init__(self, on_failure: Callable[[Exception], None]) -> None:
        self._on_failure = on_failure
        self._callbacks: list[Callable[Values, None]] = []

    def add(self, callback: Callable[Values, None]) -> None:
        """Call ``callback`` with every value from now on."""
        self._callbacks.append(callback)

    def remove(self, callback: Callable[Values, None]) -> None:
        """Call it no more; it may have been dropped already."""
        if callback in self._callbacks:
            self._callbacks.remove(callback)

    def publish(self, *args: Values.args, **kwargs: Values.kwargs) -> None:
        """Pass a value to all consumers."""
        for callback in tuple(self._callbacks):
            try:
                callback(*args, **kwargs)
            except Exception as error:  # noqa: BLE001 - becomes a visible fault, reading continues
                self._callbacks.remove(callback)
                self._on_failure(error)
