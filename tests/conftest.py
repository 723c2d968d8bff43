"""What all tests need before any of them is collected."""

from pathlib import Path

import pytest

# The arm's SDK makes this folder when it is imported, and fails where two processes do so at once.
(Path.home() / ".UFACTORY/log/xarm/sdk").mkdir(parents=True, exist_ok=True)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="Warp device on which tests/simulation roll out: cpu or cuda:0")
