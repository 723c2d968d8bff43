"""Options of the core as ROS parameters: declared with description and range, read back as options."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    InvalidTopicNameException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.validate_topic_name import validate_topic_name

from egophys_core.errors import OptionsError
from egophys_core.options import from_mapping
from egophys_ros_common.managed_node import ManagedNode

T = TypeVar("T")


def declare_number(
    node: ManagedNode, name: str, default: float, *, low: float, high: float, doc: str, at_once: bool = False
) -> None:
    """Declare a parameter that is a number in a range; a whole one if its default is an int.

    Args:
        node: that has the parameter.
        name: of it.
        default: its value unless it is given one.
        low: least value.
        high: largest value.
        doc: meaning, with the unit.
        at_once: whether it is read for each request, so that it can be set while the node is active.

    Raises:
        OptionsError: it was given a value of another type, or out of range.
    """
    descriptor = ParameterDescriptor(description=doc)
    _limit(descriptor, default, low, high)
    _declare(node, name, default, descriptor, at_once=at_once)


def declare_texts(node: ManagedNode, texts: Mapping[str, tuple[Any, str]], *, at_once: bool = False) -> None:
    """Declare parameters that have no range: names, paths, switches.

    Args:
        node: that has the parameters.
        texts: default and meaning by name.
        at_once: whether they are read for each request, so that they can be set while the node is active.

    Raises:
        OptionsError: one was given a value of another type.
    """
    for name, (default, description) in texts.items():
        _declare(node, name, default, ParameterDescriptor(description=description), at_once=at_once)


def declare_names(node: ManagedNode, names: Mapping[str, tuple[Any, str]], *, at_once: bool = False) -> None:
    """Declare parameters that name topics or services; setting one to what is no name fails.

    Args:
        node: that has the parameters.
        names: default, a name or a list of names, and meaning by parameter. A relative name (`object/points`) is in the
            namespace of the node.
        at_once: whether they are read for each request, so that they can be set while the node is active.

    Raises:
        OptionsError: one was given a value of another type, or what is no name.
    """
    declare_texts(node, names, at_once=at_once)
    for name, (default, _) in names.items():
        if (value := node.get_parameter(name).value) != default:
            _check_names(name, value)

    def check(parameters: list[Parameter]) -> SetParametersResult:
        try:
            for each in parameters:
                if each.name in names:
                    _check_names(each.name, each.value)
        except OptionsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def declare_options(node: ManagedNode, cls: type[Any], prefix: str = "", *, at_once: bool = False) -> None:
    """Declare each field of the options class `cls` as a parameter; setting one the class refuses fails.

    Args:
        node: that has the parameters.
        cls: dataclass of options.
        prefix: put before the names of the fields, with its dot (`board.`).
        at_once: whether they are read for each request, so that they can be set while the node is active.

    Raises:
        OptionsError: one was given a value of another type, or out of range.
    """
    fields = dataclasses.fields(cls)
    for field in fields:
        name = prefix + field.name
        _declare(node, name, _parameter_value(field.default), _descriptor(field), at_once=at_once)
    from_mapping(cls, _declared(node, cls, prefix))

    def check(parameters: list[Parameter]) -> SetParametersResult:
        names = {prefix + field.name for field in fields}
        changed = {each.name.removeprefix(prefix): each.value for each in parameters if each.name in names}
        try:
            if changed:
                from_mapping(cls, _declared(node, cls, prefix) | changed)
        except OptionsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def read_options(node: Node, cls: type[T], options_json: str = "") -> T:
    """Options from the node's parameters, and from a JSON object, which wins.

    Raises:
        OptionsError: not a JSON object, an unknown name, a wrong type, or out of range.
    """
    (options,) = read_option_groups(node, [(cls, "")], options_json)
    return options


def read_option_groups(node: Node, groups: Sequence[tuple[type[Any], str]], options_json: str = "") -> list[Any]:
    """Options of several classes, in their order, from the node's parameters and from one JSON object, which wins.

    Args:
        node: that has the parameters.
        groups: classes and the prefixes they were declared with.
        options_json: names with their prefix, as of the parameters: `{"generations": 20, "board.rows": 4}`.

    Raises:
        OptionsError: not a JSON object, an unknown name, a wrong type, or out of range.
    """
    values = [_declared(node, cls, prefix) for cls, prefix in groups]
    for name, value in parse_options_json(options_json).items():
        group = _group_of(name, groups)
        values[group][name.removeprefix(groups[group][1])] = value
    return [from_mapping(cls, each) for (cls, _), each in zip(groups, values, strict=True)]


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


def _declare(node: ManagedNode, name: str, default: Any, descriptor: ParameterDescriptor, *, at_once: bool) -> None:
    try:
        node.declare_parameter(name, default, descriptor)
        node.get_parameter(name)
    except InvalidParameterTypeException as error:
        raise OptionsError(f"parameter {name} must be like {default!r}: {error}") from error
    except InvalidParameterValueException as error:
        raise OptionsError(f"parameter {name} must be {_limits(descriptor)}: {error}") from error
    except ParameterUninitializedException as error:
        # An empty list has no type for ROS, and counts as no value.
        raise OptionsError(f"parameter {name} was given no value; leave it out to have {default!r}") from error
    if at_once:
        node.acts_at_once.add(name)


def _check_names(parameter: str, value: str | Sequence[str]) -> None:
    for name in [value] if isinstance(value, str) else value:
        try:
            validate_topic_name(name)
        except InvalidTopicNameException as error:
            reason = str(error).splitlines()[0].rstrip(":")
            raise OptionsError(f"parameter {parameter} must be a name, got {name!r}: {reason}") from error


def _limits(descriptor: ParameterDescriptor) -> str:
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    return ", ".join(f"{each.from_value} to {each.to_value}" for each in ranges) or descriptor.description


def _group_of(name: str, groups: Sequence[tuple[type[Any], str]]) -> int:
    """Index of the group that has a name; of one that none has, the group that its prefix says."""

    def fit(index: int) -> tuple[bool, int]:
        cls, prefix = groups[index]
        is_known = any(name == prefix + field.name for field in dataclasses.fields(cls))
        return is_known, len(prefix) if name.startswith(prefix) else -1

    return max(range(len(groups)), key=fit)


def _declared(node: Node, cls: type[Any], prefix: str) -> dict[str, Any]:
    return {field.name: node.get_parameter(prefix + field.name).value for field in dataclasses.fields(cls)}


def _parameter_value(default: Any) -> Any:
    if isinstance(default, Enum):
        return str(default)
    return list(default) if isinstance(default, tuple) else default


def _descriptor(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=field.metadata.get("doc", ""))
    if isinstance(field.default, Enum):
        descriptor.additional_constraints = f"one of: {', '.join(type(field.default))}"
    elif "low" in field.metadata:
        _limit(descriptor, field.default, field.metadata["low"], field.metadata["high"])
    return descriptor


def _limit(descriptor: ParameterDescriptor, default: Any, low: float, high: float) -> None:
    if isinstance(default, int):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    else:
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
