"""The plan file: what was written is read, and what is none is refused with the reason."""

import dataclasses
import json

import numpy as np
import pytest

from egophys_core.errors import PlanningError
from egophys_core.plan_file import PlanFile, read_plan, write_plan
from egophys_core.waypoint_plan import WaypointPlan

PLAN = WaypointPlan(
    times=np.array([0.0, 1 / 3]),
    positions=np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.4]]),
    quaternions=np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
    gripper_opening=np.array([0.08, 0.0]),
    twin_id="0123456789abcdef",
    predicted_cost=0.0123456789012345,
)
STAMP_NS = 1_700_000_000_123_456_789


@pytest.fixture
def path(tmp_path):
    write_plan(tmp_path / "plan.json", PlanFile(plan=PLAN, stamp_ns=STAMP_NS, tolerance=0.02))
    return tmp_path / "plan.json"


def test_what_was_written_is_read_to_the_bit(path):
    found = read_plan(path)
    assert (found.stamp_ns, found.tolerance, found.reached) == (STAMP_NS, 0.02, True)
    for field in dataclasses.fields(WaypointPlan):
        assert np.array_equal(getattr(found.plan, field.name), getattr(PLAN, field.name)), field.name


def test_numbers_name_their_units_and_what_is_none_is_null(path):
    content = json.loads(path.read_text())
    assert content["times_s"] == [0.0, 1 / 3]
    assert content["positions_m"][1] == [0.1, 0.2, 0.4]
    assert content["quaternions_xyzw"][0] == [1.0, 0.0, 0.0, 0.0]
    assert content["gripper_opening_m"] == [0.08, 0.0]
    no_target = PlanFile(
        plan=dataclasses.replace(PLAN, predicted_cost=float("nan")), stamp_ns=0, tolerance=float("nan")
    )
    write_plan(path, no_target)
    assert json.loads(path.read_text())["tolerance_m"] is None
    assert np.isnan(read_plan(path).plan.predicted_cost)


def test_a_plan_that_ends_too_far_off_has_not_reached_its_target(path):
    for cost in (0.0200001, float("inf"), float("nan")):
        far = dataclasses.replace(PLAN, predicted_cost=cost)
        write_plan(path, PlanFile(plan=far, stamp_ns=1, tolerance=0.02))
        assert json.loads(path.read_text())["reached"] is False
        assert not read_plan(path).reached


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"time_s": [0, 1]}, "unknown key 'time_s'; did you mean 'times_s'"),
        ({"times_s": None}, "times_s must be numbers"),
        ({"times_s": ["0", "1"]}, "times_s must be numbers"),
        ({"times_s": [0.0]}, "for 1 waypoints"),
        ({"times_s": []}, "at least one waypoint"),
        ({"times_s": 5}, r"plan times must be \[W\] seconds, one a waypoint, got \(\)"),
        ({"times_s": [-5.0, -4.0]}, "waypoint 0: time -5.000 s is before the start"),
        ({"times_s": [0.0, 0.0]}, "waypoint 1 .* 0.0000 s after the waypoint before it"),
        ({"positions_m": [[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]]}, "waypoint 1 .* farther than 20 m .*; give metres"),
        ({"positions_m": [[0.0, 0.0, float("inf")], [0.0, 0.0, 0.0]]}, "waypoint 0: position .* is not finite"),
        ({"quaternions_xyzw": [[0.0] * 4] * 2}, "waypoint 0 .* has length 0.0000, must be 1"),
        ({"quaternions_xyzw": [[9.0, 0.0, 0.0, 0.0]] * 2}, "waypoint 0 .* has length 9.0000, must be 1"),
        ({"gripper_opening_m": [-1.0, 0.0]}, r"waypoint 0 .* -1.0000 m is outside 0 \.\. 0.2 m"),
        ({"predicted_cost_m": 10**400}, "predicted_cost_m must be metres or null, got 1000"),
        ({"stamp_ns": 10**400}, "stamp_ns must be whole nanoseconds"),
        ({"positions_m": [[0, 0, 0], [0, 0]]}, "positions_m must be numbers, one row a waypoint, all of one length"),
        ({"positions_m": [[0, 0, None], [0, 0, 1]]}, "positions_m must be numbers"),
        ({"stamp_ns": 1.5}, "stamp_ns must be whole nanoseconds since the epoch, got 1.5"),
        ({"stamp_ns": True}, "stamp_ns must be whole nanoseconds"),
        ({"twin_id": 7}, "twin_id must be a text, got 7"),
        ({"predicted_cost_m": "low"}, "predicted_cost_m must be metres or null"),
        ({"reached": False}, "reached is false, but a predicted cost of 0.0123457 m .* says true"),
    ],
)
def test_content_that_is_no_plan_is_refused(path, change, text):
    # A number beyond all floats is how JSON has infinity.
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}).replace("Infinity", "1e999"))
    with pytest.raises(PlanningError, match=rf"plan .*plan.json: .*{text}"):
        read_plan(path)


def test_files_that_are_no_plan_files_are_refused(path, tmp_path):
    content = json.loads(path.read_text())
    del content["stamp_ns"], content["reached"]
    path.write_text(json.dumps(content))
    with pytest.raises(PlanningError, match="it lacks stamp_ns, reached; write it with `egophys plan`"):
        read_plan(path)
    for text, reason in (
        ("{", "cannot read plan"),
        ("[" * 100_000, "cannot read plan"),
        ("[1]", "a JSON object, got list"),
        ('{"a": NaN}', "NaN is not"),
    ):
        path.write_text(text)
        with pytest.raises(PlanningError, match=reason):
            read_plan(path)
    for absent in (tmp_path / "no.json", tmp_path):
        with pytest.raises(PlanningError, match="cannot read plan"):
            read_plan(absent)
    with pytest.raises(PlanningError, match="cannot write plan"):
        write_plan(tmp_path / "no" / "plan.json", PlanFile(plan=PLAN, stamp_ns=0, tolerance=0.02))
