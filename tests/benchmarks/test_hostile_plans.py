"""Hostile plans never put an unsafe command on the wire, and what is unsafe would be found there."""

import json
import math

import pytest

from benchmarks.fault_rig import loopback_addresses
from benchmarks.hostile_plans import unsafe_commands
from benchmarks.unsafe import measure

DOWN = [math.pi, 0.0, 0.0]
COUNT = 30


def test_no_plan_is_unsafe_on_the_wire():
    found = measure(COUNT, loopback_addresses()())
    assert [f"{each['name']}: {each['why']}" for each in found["unsafe"]] == []
    outcomes = found["outcomes"]
    assert sum(outcomes.values()) >= COUNT
    assert min(outcomes["executed"], outcomes["refused"]) > COUNT // 20
    assert set(outcomes) <= {"executed", "refused", "too long"}, "no plan may drive the controller into an error"


def streamed(*position_mm, rpy_rad=DOWN, accepted=True):
    pose = {"target_mm": list(position_mm), "orientation_rad": rpy_rad}
    return {"t": 0.0, "name": "move_servo_cart", "accepted": accepted, **pose, "tool_mm": [], "rpy_rad": []}


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ([streamed(450.0, 0.0, 322.0)], ""),
        ([streamed(900.0, 0.0, 322.0)], "outside of the box"),
        ([streamed(450.0, 0.0, 171.9)], "outside of the box"),
        ([streamed(450.0, 0.0, 322.0), streamed(456.0, 0.0, 322.0)], "a step of 6.000 mm"),
        ([streamed(450.0, 0.0, 322.0), streamed(450.0, 0.0, 322.0, rpy_rad=[math.pi, 0.0, 0.1])], "a step"),
        ([streamed(450.0, 0.0, 322.0, rpy_rad=[2.0, 0.0, 0.0])], "tilted by 1.1"),
        ([streamed(450.0, None, 322.0)], "not a number"),
        ([streamed(900.0, 0.0, 322.0, accepted=False)], ""),
        ([{"t": 0.0, "name": "move_line", "tool_mm": [], "rpy_rad": []}], "move_line may not be used"),
    ],
)
def test_an_unsafe_command_is_found(tmp_path, lines, why):
    wire = tmp_path / "wire.jsonl"
    wire.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = unsafe_commands(wire)
    assert len(found) == bool(why)
    assert not why or why in found[0]["why"]
