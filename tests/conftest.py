"""What all tests need before any of them is collected."""

from pathlib import Path

import pytest

# The arm's SDK makes this folder when it is imported, and fails where two processes do so at once.
(Path.home() / ".UFACTORY/log/xarm/sdk").mkdir(parents=True, exist_ok=True)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="Warp device on which tests/simulation roll out: cpu or cuda:0")


WAITING = ("ros", "xarm_bridge")
"""Rooms whose tests wait for other processes for most of their time."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread the files that wait evenly among those that work: side by side they would leave the cores idle."""
    root = Path(__file__).parent
    waits = {each.path: each.path.relative_to(root).parts[0] in WAITING for each in items}
    place = {}
    for group in (True, False):
        files = [path for path, one in waits.items() if one == group]
        place.update({path: (index + 0.5) / len(files) for index, path in enumerate(files)})
    items.sort(key=lambda each: place[each.path])
