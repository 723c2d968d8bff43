"""A ROS domain of this test run alone, processes that end with their test, and one client for all tests."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

# Before rclpy is imported anywhere: both are read when a process joins the graph, children inherit them.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)  # ids up to 101 keep DDS off the ephemeral ports

from egophys_ros_common.processes import Client, NodeProcess

from egophys_core.recording import read_episode, write_episode
from egophys_core.twin import Twin, save_twin
from tests.ros.cloth import NAME, cloth_episode, cloth_twin


@pytest.fixture(scope="session")
def client() -> Iterator[Client]:
    """A node in this process that calls services, sends goals and listens."""
    made = Client()
    yield made
    made.close()


@contextmanager
def processes(folder: Path) -> Iterator[Callable[..., NodeProcess]]:
    """A function that starts nodes; in the end they end, last first, and their exit codes are checked."""
    started: list[NodeProcess] = []

    def start(package: str, executable: str, *arguments: str) -> NodeProcess:
        log = folder / f"{len(started)}_{executable}.log"
        started.append(NodeProcess(package, executable, list(arguments), log))
        return started[-1]

    yield start
    failures = []
    for process in reversed(started):
        try:
            process.stop()
        except (RuntimeError, TimeoutError) as error:
            failures.append(str(error))
    assert not failures, "\n".join(failures)


@pytest.fixture
def start_node(tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """`start_node(package, executable, *arguments)`, for one test."""
    with processes(tmp_path) as start:
        yield start


@pytest.fixture(scope="class")
def start_shared_node(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., NodeProcess]]:
    """The same for nodes that the tests of a class share."""
    with processes(tmp_path_factory.mktemp("nodes")) as start:
        yield start


@pytest.fixture(scope="session")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the small cloth."""
    folder = tmp_path_factory.mktemp("bags") / NAME
    write_episode(cloth_episode(), folder, start_ns=1_700_000_000_000_000_000)
    return folder


@pytest.fixture(scope="session")
def twin(bag: Path) -> Twin:
    """The twin of that recording, built in this process."""
    return cloth_twin(read_episode(bag))


@pytest.fixture(scope="session")
def twin_file(twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The twin saved."""
    path = tmp_path_factory.mktemp("twins") / f"{NAME}.twin"
    save_twin(twin, path)
    return path


def start_twin(start: Callable[..., NodeProcess], client: Client, twin_path: Path | str = "") -> NodeProcess:
    """Start twin_node with a twin file, or without, and wait until it is active."""
    parameters = ("-p", "autostart:=true", "-p", f"twin_path:='{twin_path}'")
    node = start("egophys_twin", "twin_node", "--ros-args", *parameters)
    client.wait_for_state("/twin_node", "active")
    return node


@pytest.fixture
def start_twin_node(start_node: Callable[..., NodeProcess], client: Client) -> Callable[..., NodeProcess]:
    """`start_twin_node(twin_path)`, for one test."""
    return partial(start_twin, start_node, client)


@pytest.fixture(scope="class")
def twin_node(start_shared_node: Callable[..., NodeProcess], client: Client, twin_file: Path) -> NodeProcess:
    """An active twin_node with the twin of the small cloth, shared by the tests of a class."""
    return start_twin(start_shared_node, client, twin_file)
