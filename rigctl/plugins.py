"""Sensors, actuators, trackers, exporters and tasks by name: ours, and those of other packages.

A package declares a plug-in as an entry point of its kind's group, such as ``rigctl.sensors``
(``docs/how-to/drivers.md``). Lists are read from the packages' metadata; a plug-in is imported when
it is named, so one that fails keeps nothing else from working.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from rigctl import __version__
from rigctl.errors import RigctlError, WrongUse
from rigctl.values import PluginUse

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Contract = TypeVar("Contract")
OURS = "rigctl"


class Plugin(NamedTuple):
    """An entry point of an installed package; ``requires``: for which rigctl it is made."""

    kind: str
    name: str
    package: str
    version: str
    requires: tuple[str, ...]
    entry: EntryPoint

    def __str__(self) -> str:
        return str(self.used())

    def used(self, height_mm: float | None = None) -> PluginUse:
        """Return what a session keeps of it."""
        return PluginUse(self.kind, self.name, self.package, self.version, height_mm)

    @contextmanager
    def blamed(self, error_type: type[RigctlError] = WrongUse) -> Iterator[None]:
        """Turn whatever its code raises, but for our errors, into one sentence that names it."""
        try:
            yield
        except RigctlError:
            raise
        except Exception as error:  # top of foreign code: its failure becomes a user's sentence
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise error_type(
                f"{self} failed ({reason}): install another version of {self.package}, or ask its "
                "author"
            ) from error

    def load(self, contract: type) -> Any:
        """Return the object. Raises WrongUse for what is of another version, broken, or no such."""
        self._check_version()
        with self.blamed():
            found = self.entry.load()
        members = {*contract.__annotations__, *vars(contract)}
        public = {name for name in members if not name.startswith("_") or name == "__call__"}
        if missing := sorted(name for name in public if not hasattr(found, name)):
            raise WrongUse(
                f"{self} is no {self.kind}, it lacks {', '.join(missing)}: install another version "
                f"of {self.package}, or ask its author"
            )
        return found

    def _check_version(self) -> None:
        from packaging.requirements import Requirement
        from packaging.utils import canonicalize_name

        for requirement in map(Requirement, self.requires):
            is_ours = canonicalize_name(requirement.name) == OURS
            if is_ours and not requirement.specifier.contains(__version__, prereleases=True):
                raise WrongUse(
                    f"{self} is made for rigctl {requirement.specifier}, this is {__version__}: "
                    f"pip install --upgrade {self.package}, or take the rigctl that it is made for"
                )


@cache
def installed(kind: str) -> tuple[Plugin, ...]:
    """Return the plug-ins of a kind that installed packages declare, by name and package."""
    from importlib.metadata import entry_points

    found = [
        Plugin(kind, one.name, one.dist.name, one.dist.version, tuple(one.dist.requires or ()), one)
        for one in entry_points(group=f"rigctl.{kind}s")
        if one.dist is not None
    ]
    return tuple(sorted(found, key=lambda one: (one.name, one.package)))


@dataclass(frozen=True, slots=True)
class Lookup(Generic[Contract]):
    """What can be named of a kind: ``ours`` by name, and plug-ins that fulfil the ``contract``.

    ``check``: raises WrongUse, which begins with its second argument, for an object that the
    contract alone does not refuse.
    """

    kind: str
    ours: Mapping[str, Contract]
    contract: type
    check: Callable[[Any, Plugin], None] = lambda found, plugin: None

    @property
    def names(self) -> tuple[str, ...]:
        """All names: ours first."""
        return tuple(dict.fromkeys((*self.ours, *(one.name for one in installed(self.kind)))))

    def plugin(self, name: str) -> Plugin | None:
        """Return the package's plug-in of this name, None for one of ours.

        Raises WrongUse for a name that nothing has, or that two have.
        """
        found = [one for one in installed(self.kind) if one.name == name]
        packages = [*([OURS] if name in self.ours else []), *(one.package for one in found)]
        if not packages:
            raise WrongUse(
                f"there is no {self.kind} {name}: choose from {', '.join(self.names) or 'none'}, "
                "or install the package that brings it"
            )
        if len(packages) > 1:
            raise WrongUse(
                f"{' and '.join(packages)} each bring the {self.kind} {name}: "
                f"pip uninstall {packages[-1]}, or ask its author for another name"
            )
        return found[0] if found else None

    def load(self, name: str) -> Contract:
        """Return what the name stands for. Raises WrongUse as :meth:`plugin` and for a broken one.

        What is wrong with a package is said of it alone; the others stay usable.
        """
        plugin = self.plugin(name)
        if plugin is None:
            return self.ours[name]
        found: Contract = plugin.load(self.contract)
        self.check(found, plugin)
        return found

    @contextmanager
    def blamed(self, name: str, error_type: type[RigctlError] = WrongUse) -> Iterator[None]:
        """As :meth:`Plugin.blamed` for a plug-in; errors of ours stay as they are."""
        plugin = self.plugin(name)
        if plugin is None:
            yield
        else:
            with plugin.blamed(error_type):
                yield
