"""Options of the core as ROS parameters: declared with description and range, read back as options."""

import dataclasses
import json
from enum import Enum
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from egophys_core.errors import OptionsError
from egophys_core.options import from_mapping

T = TypeVar("T")


def declare_options(node: Node, cls: type[Any]) -> None:
    """Declare each field of the options class `cls` as a parameter; setting one the class refuses fails."""
    fields = dataclasses.fields(cls)
    for field in fields:
        node.declare_parameter(field.name, _parameter_value(field.default), _descriptor(field))
    names = {field.name for field in fields}

    def check(parameters: list[Parameter]) -> SetParametersResult:
        changed = {each.name: each.value for each in parameters if each.name in names}
        try:
            from_mapping(cls, {name: node.get_parameter(name).value for name in names} | changed)
        except OptionsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def read_options(node: Node, cls: type[T], options_json: str = "") -> T:
    """Options from the node's parameters, and from a JSON object, which wins.

    Raises:
        OptionsError: not a JSON object, an unknown name, a wrong type, or out of range.
    """
    values = {field.name: node.get_parameter(field.name).value for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    return from_mapping(cls, values | parse_options_json(options_json))


def parse_options_json(options_json: str) -> dict[str, Any]:
    """Names and values of a JSON object; none if the text is empty.

    Raises:
        OptionsError: not a JSON object.
    """
    try:
        values = json.loads(options_json or "{}")
    except json.JSONDecodeError as error:
        raise OptionsError(f"options_json is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise OptionsError(f"options_json must be a JSON object of names and values, got {options_json}")
    return values


def _parameter_value(default: Any) -> Any:
    if isinstance(default, Enum):
        return str(default)
    return list(default) if isinstance(default, tuple) else default


def _descriptor(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=field.metadata.get("doc", ""))
    if isinstance(field.default, Enum):
        descriptor.additional_constraints = f"one of: {', '.join(type(field.default))}"
    elif "low" in field.metadata:
        low, high = field.metadata["low"], field.metadata["high"]
        if isinstance(field.default, int):
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
    return descriptor
