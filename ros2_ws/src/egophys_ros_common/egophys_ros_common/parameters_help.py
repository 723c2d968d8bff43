"""What a node prints for `--help`: its parameters with types, defaults, ranges and meaning."""

from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter


def parameters_text(node: Node) -> str:
    """All parameters that a node declares, three lines each at most."""
    # rclpy declares some of its own, which every ROS node has.
    own = {name: value for name, value in sorted(node.get_parameters_by_prefix("").items()) if not _is_ros(name)}
    described = zip(own.values(), node.describe_parameters(list(own)), strict=True)
    return "\n".join(_entry(parameter, descriptor) for parameter, descriptor in described)


def _is_ros(name: str) -> bool:
    return name in ("use_sim_time", "start_type_description_service") or name.startswith("qos_overrides.")


def _entry(parameter: Parameter, descriptor: Any) -> str:
    limits = [f"{each.from_value:g} to {each.to_value:g}" for each in descriptor.floating_point_range]
    limits += [f"{each.from_value} to {each.to_value}" for each in descriptor.integer_range]
    kind = ", ".join([parameter.type_.name.lower(), *limits])
    lines = [f"  {parameter.name} ({kind}), default {parameter.value!r}", f"      {descriptor.description}"]
    if descriptor.additional_constraints:
        lines.append(f"      {descriptor.additional_constraints}")
    return "\n".join(lines)
