"""Forces on every node, against the motion of a point."""

import numpy as np
import pytest

from egophys_core.effects import LIBRARY
from tests.effects.situations import DT as SUBSTEP
from tests.effects.situations import (
    FRAME,
    G,
    accelerations,
    centre_path,
    run,
    sheet,
    surroundings,
    with_effect,
)
from tests.reference.effects import node_force

FLOAT32 = 1e-5


def test_quadratic_drag_lets_an_object_fall_at_its_terminal_speed():
    # v(t) = w tanh(g t / w), w = sqrt(g / c).
    model = with_effect(sheet(drag=0.0), "quadratic_drag", coefficient=20.0)
    speed = np.sqrt(G / 20.0)
    result = run(model, duration=1.0)
    assert result.velocities[0, :, 2] == pytest.approx(-speed * np.tanh(G / speed), rel=1e-3)


def test_a_constant_body_force_moves_by_half_its_square_of_time():
    # x = a t^2 / 2; semi-implicit Euler goes a t dt / 2 too far.
    result = run(with_effect(sheet(gravity=0.0, drag=0.0), "constant_body_force", x=0.5, y=-1.0, z=2.0))
    displacement = centre_path(result)[-1] - centre_path(result)[0]
    exact = np.array([0.5, -1.0, 2.0]) * (0.5**2 + 0.5 * SUBSTEP) / 2
    assert displacement == pytest.approx(exact, abs=FLOAT32)


@pytest.mark.parametrize(("onset", "lasted"), [(0.11, 0.25), (0.35, 0.15), (0.9, 0.0)])
def test_a_gust_leaves_a_speed_of_acceleration_times_duration(onset, lasted):
    effect = {"x": 2.0, "y": 0.0, "z": -1.0, "onset": onset, "duration": 0.25, "frequency": 0.0, "phase": 0.0}
    result = run(with_effect(sheet(gravity=0.0, drag=0.0), "time_varying_body_force", **effect))
    assert result.velocities[0].mean(axis=0) == pytest.approx(lasted * np.array([2.0, 0.0, -1.0]), abs=FLOAT32)


def test_a_force_to_and_fro_leaves_the_integral_of_its_sine():
    # v = A (1 - cos w t) / w for a = A sin w t; the force of a substep is that at its middle.
    effect = {"x": 2.0, "y": 0.0, "z": 0.0, "onset": 0.0, "duration": 9.0, "frequency": 0.8, "phase": np.pi / 2}
    result = run(with_effect(sheet(gravity=0.0, drag=0.0), "time_varying_body_force", **effect))
    pulsation = 2.0 * np.pi * 0.8
    exact = 2.0 * (1.0 - np.cos(pulsation * 0.5)) / pulsation
    assert result.velocities[0, :, 0].mean() == pytest.approx(exact, rel=1e-5)


def test_the_starts_of_a_force_that_comes_and_goes_are_sums_of_its_pieces():
    """They leave a free body at the speed that the pieces leave it at, wherever a piece ends."""
    around = surroundings(sheet())
    effect = LIBRARY["time_varying_body_force"]
    starts = effect.starts(around)
    pieces, shares = effect.superposition(around, starts)
    frames = np.arange(0.0, around.end, FRAME)
    nodes = np.zeros((1, 3))
    known = {"start": nodes, "rest": nodes, "masses": np.ones(1), "gravity": G, "ground": 0.0, "begins": 0.0}

    def speeds(values: dict[str, float]) -> np.ndarray:
        force = node_force("time_varying_body_force", values, **known)
        return FRAME * np.cumsum([force(time, FRAME, nodes, nodes)[0, 0] for time in frames])

    ends = [round((piece["onset"] + piece["duration"]) / FRAME) - 1 for piece in pieces]
    of_pieces = np.array([speeds(piece) for piece in pieces])[:, ends]
    for start, share in list(zip(starts, shares, strict=True))[::7]:
        assert speeds(start)[ends] == pytest.approx(share @ of_pieces, abs=2e-3)


def test_gravity_scale_scales_the_fall():
    result = run(with_effect(sheet(drag=0.0), "gravity_scale", scale=0.5))
    assert result.velocities[0, :, 2] == pytest.approx(-0.5 * G * 0.5, rel=1e-5)


def test_gravity_tilt_turns_the_fall_and_keeps_its_size():
    # Turned about x by a, gravity (0, 0, -g) becomes (0, g sin a, -g cos a).
    result = run(with_effect(sheet(drag=0.0), "gravity_tilt", about_x=0.2, about_y=0.0))
    exact = G * 0.5 * np.array([0.0, np.sin(0.2), -np.cos(0.2)])
    assert result.velocities[0].mean(axis=0) == pytest.approx(exact, abs=1e-4)


def test_tilt_acts_on_gravity_as_another_effect_scaled_it():
    model = with_effect(sheet(drag=0.0), "gravity_scale", scale=0.5)
    result = run(with_effect(model, "gravity_tilt", about_x=0.0, about_y=0.3))
    exact = 0.5 * G * 0.5 * np.array([-np.sin(0.3), 0.0, -np.cos(0.3)])
    assert result.velocities[0].mean(axis=0) == pytest.approx(exact, abs=1e-4)


def test_a_point_attracts_most_at_its_range_and_repels_with_the_other_sign():
    values = {"x": 0.0, "y": 0.0, "z": 1.0, "strength": 3.0, "range": 0.2}
    heights = np.array([1.0, 0.9, 0.8, 0.6, -1.0])
    nodes = np.stack([0 * heights, 0 * heights, heights], axis=1)
    pull = accelerations("point_attraction", values, nodes)
    assert pull[0] == pytest.approx(0.0)
    assert pull[2] == pytest.approx([0, 0, 3.0], abs=1e-5)
    assert np.argmax(pull[:, 2]) == 2
    assert np.abs(pull[4]).max() < 1e-6
    push = accelerations("point_attraction", {**values, "strength": -3.0}, nodes)
    assert push == pytest.approx(-pull)


AT_THE_MIDDLE = {"x": 0.0, "y": 0.0, "z": 0.0, "anchor_x": 0.0, "anchor_y": 0.0}


def test_a_tether_holds_the_object_where_force_and_stretch_balance():
    # M a = M k (|d| - length): it comes to rest at length + a / k from where its tied place began.
    model = sheet(gravity=0.0, drag=4.0, stiffness=200.0, damping=0.1)
    model = with_effect(model, "constant_body_force", x=1.0, y=0.0, z=0.0)
    tether = {**AT_THE_MIDDLE, "stiffness": 20.0, "length": 0.03}
    result = run(with_effect(model, "hidden_tether", **tether), duration=4.0)
    middle = result.positions[0][:, np.linalg.norm(result.positions[0, 0], axis=1) < 0.04].mean(axis=1)
    assert middle[-1] - middle[0] == pytest.approx([0.03 + 1.0 / 20.0, 0, 0], abs=1e-3)


def test_a_stiff_tether_swings_for_long_without_gaining():
    # Without any damping.
    model = with_effect(sheet(gravity=0.0, drag=0.0, stiffness=100.0), "constant_body_force", x=1.0, y=0.0, z=0.0)
    tether = {**AT_THE_MIDDLE, "stiffness": 100.0, "length": 0.0}
    displacement = centre_path(run(with_effect(model, "hidden_tether", **tether), duration=4.0))[:, 0]
    half = len(displacement) // 2
    assert np.ptp(displacement[half:]) < 1.02 * np.ptp(displacement[:half])


def test_a_slack_tether_does_nothing():
    values = {**AT_THE_MIDDLE, "stiffness": 20.0, "length": 0.05}
    still, slack, taut = (
        accelerations("hidden_tether", values, [[0, 0, height]], start=[[0, 0, 0]]) for height in (0.0, 0.04, 0.06)
    )
    assert (still == 0).all()
    assert (slack == 0).all()
    assert taut == pytest.approx(np.array([[0, 0, -20.0 * 0.01]]), rel=1e-5)


def test_a_tether_pulls_towards_its_anchor_beside():
    values = {**AT_THE_MIDDLE, "anchor_x": 0.3, "anchor_y": -0.4, "stiffness": 20.0, "length": 0.1}
    pull = accelerations("hidden_tether", values, [[0, 0, 0]])
    assert pull == pytest.approx(20.0 * (0.5 - 0.1) * np.array([[0.6, -0.8, 0.0]]), rel=1e-5, abs=1e-6)


def test_adhesion_is_nothing_on_the_table_its_strength_at_its_reach_and_takes_its_work():
    # The integral of s u exp(1 - u) over the height is s reach e.
    heights = np.concatenate([[0.0, -0.001, 0.01], np.linspace(0.0, 0.3, 3001)])
    nodes = np.stack([0 * heights, 0 * heights, heights], axis=1)
    pull = accelerations("table_adhesion", {"strength": 5.0, "reach": 0.01}, nodes)[:, 2]
    assert pull[:3].tolist() == pytest.approx([0.0, 0.0, -5.0], abs=1e-4)
    assert np.trapz(pull[3:], heights[3:]) == pytest.approx(-5.0 * 0.01 * np.e, rel=1e-3)


def test_drag_is_quadratic():
    speeds = np.array([0.0, 0.3, 2.0])
    nodes = np.stack([speeds, 0 * speeds, 1.0 + 0 * speeds], axis=1)
    velocities = np.stack([0 * speeds, -speeds, 0 * speeds], axis=1)
    slowing = accelerations("quadratic_drag", {"coefficient": 3.0}, nodes, velocities=velocities)
    assert slowing[:, 1] == pytest.approx(3.0 * speeds**2, rel=1e-5)


def test_drag_never_turns_an_object_round_however_fast_it_is():
    model = with_effect(sheet(gravity=0.0, drag=0.0), "quadratic_drag", coefficient=60.0)
    result = run(model, velocity=(200.0, 0.0, 0.0), duration=0.2)
    steps = np.diff(centre_path(result)[:, 0])
    assert (steps > 0).all()
    assert (np.diff(steps) < 0).all()
