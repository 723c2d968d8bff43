"""What is wrong with the arguments of a launch file, found before anything starts.

Launch files run in the Python of `launch`, which need not have the packages that the nodes have: this imports none.
"""

import difflib
import ipaddress
import os
from collections.abc import Collection
from pathlib import Path


class ArgumentError(RuntimeError):
    """An argument of a launch file that cannot be; `launch` prints the message and ends."""


def require_new_folder(name: str, value: str) -> None:
    """Check that an argument names a folder that can be made, or is empty.

    Raises:
        ArgumentError: it exists, or may not be made there.
    """
    if not value:
        return
    folder = Path(value).expanduser().absolute()
    if folder.exists():
        raise ArgumentError(f"{name}: {folder} exists already and is not overwritten; choose another name")
    parent = next(each for each in folder.parents if each.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise ArgumentError(f"{name}: {folder} cannot be made, no right to write in {parent}; choose another place")


def require_file(name: str, value: str) -> None:
    """Check that an argument names a file, or is empty.

    Raises:
        ArgumentError: there is no such file.
    """
    if value and not Path(value).expanduser().is_file():
        raise ArgumentError(f"{name}: there is no file {Path(value).absolute()}; give the path of one")


def require_loopback(name: str, value: str) -> None:
    """Check that an argument is an address on which an emulator can be started.

    Raises:
        ArgumentError: it is another machine, a real robot's control box perhaps, or no address.
    """
    try:
        is_loopback = ipaddress.IPv4Address(value).is_loopback
    except ValueError:
        is_loopback = False
    if not is_loopback:
        raise ArgumentError(
            f"{name}:={value} is not on this machine, where use_emulator starts the emulator; for a real arm give "
            "use_emulator:=false too, for the emulator an address as 127.0.0.1"
        )


def require_no_misspelling(given: Collection[str], known: Collection[str]) -> None:
    """Check that no argument is nearly one that is known; `launch` would drop it silently.

    Raises:
        ArgumentError: one is.
    """
    for name in sorted(set(given) - set(known)):
        if near := difflib.get_close_matches(name, known, n=1, cutoff=0.85):
            raise ArgumentError(f"there is no argument {name}; did you mean {near[0]}? --show-args lists all")
