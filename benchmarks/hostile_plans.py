"""Plans that an arm must refuse or execute safely, and what safe is, said again without the bridge's code.

The limits stand here as numbers: a mistake in `egophys_core.robot` must not hide itself.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from egophys_core.waypoint_plan import WaypointPlan

# What benchmarks and tests give the bridge: the box in the robot base frame, the table at z = 0, millimetres here.
BOX_LOW_MM, BOX_HIGH_MM = np.array([200.0, -400.0, 0.0]), np.array([650.0, 400.0, 500.0])
TOOL_MM = np.array([0.0, 0.0, 172.0])
BASE_IN_WORLD_MM = np.array([-450.0, 0.0, 0.0])
STEEPEST_RAD = 1.0
LARGEST_STEP_MM = 0.25 * 0.02 * 1000.0
LARGEST_TURN_RAD = 1.0 * 0.02
ROUNDING_MM, ROUNDING_RAD = 0.01, 1e-4
"""float32 on the wire."""

STREAMED, REST = "move_servo_cart", {"motion_en", "set_state", "set_mode", "clean_err", "clean_war", "changed"}
"""The only command that may move the arm, and what may stand beside it on the wire."""

FAR = st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e9, 1e-300, 450.0, -120.0])
"""Numbers that no plan has, millimetres taken for metres among them."""


@st.composite
def plans(draw: st.DrawFn) -> WaypointPlan:
    """Plans near the middle of the box that mostly could be executed, some of them spoilt in one or several ways."""
    count = draw(st.integers(1, 6))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    reach = draw(st.sampled_from([0.01, 0.03, 0.1, 0.4]))
    positions = np.array([0.0, 0.0, 0.15]) + np.cumsum(random.normal(scale=reach, size=(count, 3)), axis=0) / 3
    pace = draw(st.sampled_from([0.05, 0.2, 0.2499, 0.2501, 1.0]))
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    times = np.concatenate([[0.0], np.cumsum(np.maximum(lengths / pace, 0.02))])
    tilt = draw(st.sampled_from([0.0, 0.0, 0.3, 0.99, 1.5, np.pi]))
    turns = Rotation.from_euler("zx", np.stack([random.uniform(-0.3, 0.3, count), np.full(count, tilt)], axis=1))
    quaternions = (turns * Rotation.from_quat([1.0, 0.0, 0.0, 0.0])).as_quat()
    fields = {
        "times": times,
        "positions": positions,
        "quaternions": quaternions,
        "gripper_opening": random.uniform(0.0, 0.085, count),
    }
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 1, 2]))):
        draw(st.sampled_from(SPOILERS))(draw, fields)
    return WaypointPlan(**fields, twin_id="", predicted_cost=0.0)


def _put_a_far_number(draw: st.DrawFn, fields: dict[str, np.ndarray]) -> None:
    values = fields[draw(st.sampled_from(sorted(fields)))]
    values.flat[draw(st.integers(0, values.size - 1))] = draw(FAR)


def _touch_a_face(draw: st.DrawFn, fields: dict[str, np.ndarray]) -> None:
    """Just inside or just outside of the box or the table."""
    axis, side = draw(st.integers(0, 2)), draw(st.sampled_from([BOX_LOW_MM, BOX_HIGH_MM]))
    face = (side[axis] + BASE_IN_WORLD_MM[axis]) / 1000.0
    waypoint = draw(st.integers(0, len(fields["times"]) - 1))
    fields["positions"][waypoint, axis] = face + draw(st.sampled_from([-1e-3, -1e-9, 0.0, 1e-9, 1e-3]))


def _flip_signs(draw: st.DrawFn, fields: dict[str, np.ndarray]) -> None:
    """q and -q are the same orientation, and the way between them is none."""
    fields["quaternions"][draw(st.integers(0, len(fields["times"]) - 1))] *= -1.0


def _put_w_first(draw: st.DrawFn, fields: dict[str, np.ndarray]) -> None:
    fields["quaternions"] = np.roll(fields["quaternions"], 1, axis=1)


def _turn_half_round(draw: st.DrawFn, fields: dict[str, np.ndarray]) -> None:
    """A waypoint turned far from the others; slowly enough in half of the cases."""
    waypoint = draw(st.integers(0, len(fields["times"]) - 1))
    angles = [draw(st.floats(-3.1, 3.1)), draw(st.floats(-1.1, 1.1)), draw(st.floats(-3.1, 3.1))]
    turned = Rotation.from_euler("ZXZ", angles) * Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
    fields["quaternions"][waypoint] = turned.as_quat()
    fields["times"] = fields["times"] * draw(st.sampled_from([1.0, 20.0]))


def _upset_time(draw: st.DrawFn, fields: dict[str, np.ndarray]) -> None:
    waypoint = draw(st.integers(0, len(fields["times"]) - 1))
    fields["times"][waypoint] += draw(st.sampled_from([-10.0, -0.02, -1e-9, 1e-9, 5.0]))


def _hurry(draw: st.DrawFn, fields: dict[str, np.ndarray]) -> None:
    fields["times"] = fields["times"] * draw(st.sampled_from([1e-6, 0.5, 0.98]))


SPOILERS = [_put_a_far_number, _touch_a_face, _flip_signs, _put_w_first, _turn_half_round, _upset_time, _hurry]


def unsafe_commands(wire: Path) -> list[dict[str, Any]]:
    """Lines of an emulator's wire after which an arm would have been where, or as fast as, it must not be.

    Each has a key `why`. The first pose of a stream is held against where the tool was.
    """
    found, before = [], None
    for text in wire.read_text().splitlines():
        line = json.loads(text)
        why = ""
        if line["name"] == STREAMED:
            pose = _tool(line["target_mm"], line["orientation_rad"])
            if line["accepted"]:
                why = _forbidden(pose) or (_jumped(before, pose) if before is not None else "")
                before = pose
        elif line["name"] not in REST:
            why = f"{line['name']} may not be used"
        elif line["name"] == "changed" and line["error"]:
            why = f"the controller was driven into error {line['error']}"
        if line["name"] in ("set_mode", "changed"):
            before = _tool(line["tool_mm"], line["rpy_rad"])
        if why:
            found.append({**line, "why": why})
    return found


def _tool(position_mm: list[float | None], rpy_rad: list[float | None]) -> tuple[np.ndarray, Rotation]:
    """Tool point in the robot base frame of a TCP pose as commanded; NaN for what is no number."""
    position, angles = np.array(position_mm, np.float64), np.array(rpy_rad, np.float64)
    rotation = Rotation.from_euler("xyz", np.nan_to_num(angles))
    return np.where(np.isfinite(angles).all(), position, np.nan) + rotation.apply(TOOL_MM), rotation


def _forbidden(pose: tuple[np.ndarray, Rotation]) -> str:
    point, rotation = pose
    if not np.isfinite(point).all():
        return "not a number"
    if (point < BOX_LOW_MM - ROUNDING_MM).any() or (point > BOX_HIGH_MM + ROUNDING_MM).any():
        return f"the tool point {point.round(3).tolist()} mm is outside of the box"
    tilt = float(np.arccos(np.clip(-rotation.as_matrix()[2, 2], -1.0, 1.0)))
    return f"tilted by {tilt:.4f} rad" if tilt > STEEPEST_RAD + ROUNDING_RAD else ""


def _jumped(before: tuple[np.ndarray, Rotation], pose: tuple[np.ndarray, Rotation]) -> str:
    step = float(np.linalg.norm(pose[0] - before[0]))
    turn = float((before[1].inv() * pose[1]).magnitude())
    if step > LARGEST_STEP_MM + ROUNDING_MM or turn > LARGEST_TURN_RAD + 10 * ROUNDING_RAD:
        return f"a step of {step:.3f} mm and {turn:.4f} rad"
    return ""
