"""Rooms that load their modules when a public name is first used, so that their options can be had without them."""

import importlib
from collections.abc import Callable
from typing import Any


def names_on_demand(package: str, *modules: str) -> Callable[[str], Any]:
    """The `__getattr__` of a room whose public names are found in its modules, which are imported then.

    Args:
        package: `__name__` of the room, whose `__all__` lists what may be asked for.
        modules: names of its modules, without the room's, in the order in which they are looked through.
    """

    def look_up(name: str) -> Any:
        room = importlib.import_module(package)
        for module in modules if name in room.__all__ else ():
            found = importlib.import_module(f"{package}.{module}")
            if hasattr(found, name):
                setattr(room, name, getattr(found, name))
                return getattr(found, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return look_up
