"""Message types by name: the Python class to subscribe with, and the definition a log carries."""

from importlib import import_module
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from egophys_core.errors import RecordingError
from egophys_core.recording import MessageDefinition, definition_from_folder, jazzy_types, standard_definition


def message_class(type_name: str) -> Any:
    """The class of `sensor_msgs/msg/PointCloud2`.

    Raises:
        RecordingError: its package is not installed where this node runs.
    """
    package, _, name = type_name.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise RecordingError(f"no message type {type_name} here ({error}); is {package} built and sourced?") from error


def message_definition(type_name: str) -> MessageDefinition:
    """What a log says of a type: from the standard messages, else from the installed package.

    Raises:
        RecordingError: there is no such message.
    """
    if type_name in jazzy_types().fielddefs:
        return standard_definition(type_name)
    package = type_name.split("/")[0]
    try:
        folder = Path(get_package_share_directory(package), "msg")
    except PackageNotFoundError as error:
        raise RecordingError(f"no definition of {type_name}: {package} is not installed here") from error
    return definition_from_folder(type_name, folder)
