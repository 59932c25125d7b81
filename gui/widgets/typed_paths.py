"""Paths as the user types them into a field; also for the worker process, which has no Qt."""

from __future__ import annotations

from pathlib import Path

from rigctl.errors import WrongUse

NO_FOLDER = "choose a folder to save in"
NO_WHOLE_PATH = "give the whole path of the folder to save in, or one that begins with ~"


def typed_path(text: str) -> Path:
    """Return the path that a field has, from the home folder where it begins with ``~``.

    Where no user has the name behind the ``~`` the path stays as it is: nothing is there, and
    who reads it says so.
    """
    path = Path(text.strip())
    try:
        return path.expanduser()
    except RuntimeError:
        return path


def folder_problem(text: str) -> str:
    """Return what is wrong with the folder, empty for nothing.

    A path without a beginning would be one below the folder in which the program was started.
    """
    if not text.strip():
        return NO_FOLDER
    return "" if typed_path(text).is_absolute() else NO_WHOLE_PATH


def new_files_folder(text: str) -> Path:
    """Return the folder. Raises WrongUse where none is named, or one that is no whole path."""
    if problem := folder_problem(text):
        raise WrongUse(problem)
    return typed_path(text)
