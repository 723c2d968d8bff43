"""What all tests need before any of them is collected."""

from pathlib import Path

import pytest

from egophys_core.simulation import rollout
from egophys_core.simulation.gradients import differentiate

# The arm's SDK makes this folder when it is imported, and fails where two processes do so at once.
(Path.home() / ".UFACTORY/log/xarm/sdk").mkdir(parents=True, exist_ok=True)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", default="cpu", help="Warp device of rollouts that name none: cpu or cuda:0")


def pytest_configure(config: pytest.Config) -> None:
    for function in (rollout, differentiate):
        function.__kwdefaults__["device"] = config.getoption("--device")
