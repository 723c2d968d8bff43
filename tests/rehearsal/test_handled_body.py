"""The body in the engine: it rests, it is held, and each injected effect moves it the way it should."""

import numpy as np
import pytest

from egophys_core.errors import SimulationError
from egophys_core.rehearsal import RehearsalObject, RehearsalOptions
from egophys_core.rehearsal.bodies import make_body
from egophys_core.rehearsal.engine import FlexEngine
from egophys_core.rehearsal.handled_body import HandledBody
from egophys_core.rehearsal.hands import Hands

SHEET = RehearsalOptions(points=30, spread=0.0)
ELLIPSOID = RehearsalOptions(object=RehearsalObject.ELLIPSOID, points=30, spread=0.0)
LIFT = np.array([0.05, 0.0, 0.1])
"""Metres."""


def rise(time: float) -> np.ndarray:
    share = np.clip(time / 0.3, 0.0, 1.0)
    return LIFT * share**2 * (3.0 - 2.0 * share)


def at(centres: np.ndarray, turn: float = 0.0) -> Hands:
    """Hands that are turned alike."""
    return Hands(centres=np.asarray(centres), turns=np.full(len(centres), turn))


def lifted(options, effects, *, until=0.5):
    """Where the tracked points are after a corner or the top was lifted: before, and at the end."""
    handled = HandledBody(make_body(options, 0), effects)
    before = handled.points
    high = handled.vertices[:, 2].max()
    grasp = np.array([[0.13, -0.095, high] if options is SHEET else [0.0, 0.0, high - 0.005]])
    handled.close_grip(handled.true_hands(lambda _: at(grasp))(0.0))
    handled.advance(handled.true_hands(lambda time: at(grasp + rise(time))), until)
    return before, handled.points


@pytest.fixture(scope="module")
def sheet():
    return lifted(SHEET, {})


@pytest.fixture(scope="module")
def ellipsoid():
    return lifted(ELLIPSOID, {})


@pytest.mark.parametrize("options", [SHEET, ELLIPSOID], ids=["sheet", "ellipsoid"])
def test_a_body_left_alone_rests_on_the_table(options):
    handled = HandledBody(make_body(options, 0), {})
    before = handled.points
    handled.advance(lambda _: at(np.zeros((1, 3))), 0.3)
    np.testing.assert_allclose(handled.points, before, atol=5e-4)
    assert handled.vertices[:, 2].min() > 0.001


def test_the_table_carries_the_weight():
    body = make_body(SHEET, 0)
    engine = FlexEngine(body, step=4e-4, pressing=0, folding=False)
    for _ in range(500):
        engine.step()
    assert engine.table_pressures().sum() == pytest.approx(9.81 * body.mass, rel=1e-3)


def test_what_is_held_follows_the_hand(ellipsoid):
    before, after = ellipsoid
    # The body still swings a little below the hand and has stretched under its weight.
    np.testing.assert_allclose((after - before).mean(axis=0), LIFT, atol=0.02)


def test_what_is_held_turns_with_the_hand():
    """Held near its middle and turned by a right angle, a lifted toy lies across where it lay."""
    handled = HandledBody(make_body(ELLIPSOID, 0), {})
    grasp = np.array([[0.0, 0.0, handled.vertices[:, 2].max() - 0.01]])
    handled.close_grip(at(grasp, 0.3))
    before = handled.points
    handled.advance(lambda time: at(grasp + rise(time), 0.3 + np.pi / 2.0 * np.clip((time - 0.3) / 0.5, 0.0, 1.0)), 1.2)
    along, across = (points[:, :2] - points[:, :2].mean(axis=0) for points in (before, handled.points))
    turned = along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert np.linalg.norm(across - turned, axis=1).mean() < 0.35 * np.linalg.norm(across - along, axis=1).mean()


def test_what_is_let_go_falls():
    handled = HandledBody(make_body(ELLIPSOID, 0), {})
    grasp = np.array([[0.0, 0.0, handled.vertices[:, 2].max()]])
    handled.close_grip(at(grasp))
    handled.advance(lambda time: at(grasp + rise(time)), 0.4)
    high = handled.points[:, 2].mean()
    handled.open_grip()
    handled.advance(lambda time: at(grasp + rise(time)), 0.7)
    assert handled.points[:, 2].mean() < high - 0.05


def test_a_hand_far_away_holds_nothing():
    handled = HandledBody(make_body(SHEET, 0), {})
    before = handled.points
    handled.close_grip(at(np.array([[0.0, 0.0, 0.3]])))
    handled.advance(lambda time: at(np.array([[0.0, 0.0, 0.3 + time]])), 0.2)
    np.testing.assert_allclose(handled.points, before, atol=5e-4)


def test_a_ball_pushes_a_solid_but_does_not_hold_it():
    body = make_body(ELLIPSOID, 0)
    handled = HandledBody(body, {}, pressing=1)
    before = handled.points
    start = np.array([[body.vertices[:, 0].max() + 0.032, 0.0, 0.04]])
    handled.advance(lambda time: at(start - [0.1 * min(time, 0.6), 0.0, 0.0]), 0.6)
    moved = (handled.points - before)[:, 0]
    assert -0.07 < moved.mean() < -0.02
    handled.advance(lambda time: at(start - [0.06 - 0.2 * (time - 0.6), 0.0, 0.0]), 0.9)
    assert (handled.points - before)[:, 0].mean() < -0.02


@pytest.mark.slow
def test_layers_of_a_folding_sheet_do_not_pass_each_other():
    def height(folding):
        handled = HandledBody(make_body(SHEET, 0), {}, folding=folding)
        grasp = np.array([[-0.13, y, 0.005] for y in (-0.095, 0.0, 0.095)])
        handled.close_grip(at(grasp))

        def over(time):
            turn = np.pi * min(time / 0.6, 1.0)
            return at(grasp + [0.11 * (1.0 - np.cos(turn)), 0.0, 0.1 * np.sin(turn)])

        handled.advance(over, 0.75)
        return np.quantile(handled.vertices[:, 2], 0.6)

    assert height(True) > height(False) + 0.002


@pytest.mark.parametrize(
    ("effect", "way"),
    [
        ({"quadratic_drag": {"coefficient": 60.0}}, [0.0, 0.0, -1.0]),
        ({"constant_body_force": {"x": 0.0, "y": 3.0, "z": 0.0}}, [0.0, 1.0, 0.0]),
        (
            {"time_varying_body_force": {"x": 0.0, "y": 6.0, "z": 0.0, "frequency": 1.0, "onset": 0.1, "phase": 1.57}},
            [0.0, 1.0, 0.0],
        ),
        ({"gravity_scale": {"scale": 0.3}}, [0.0, 0.0, 1.0]),
        ({"gravity_tilt": {"about_x": 0.3, "about_y": 0.0}}, [0.0, 1.0, 0.0]),
        ({"point_attraction": {"x": 0.0, "y": 0.3, "z": 0.05, "strength": 8.0, "range": 0.2}}, [0.0, 1.0, 0.0]),
        (
            {
                "hidden_tether": {
                    **{"x": 0.0, "y": 0.0, "z": 0.05, "anchor_x": 0.0, "anchor_y": 0.15},
                    **{"stiffness": 32.0, "length": 0.05},
                }
            },
            [0.0, 1.0, 0.0],
        ),
        ({"gripper_offset": {"x": -0.01, "y": 0.0, "z": 0.0}}, None),
        ({"grasp_slip": {"z": -0.1, "onset": 0.1}}, [0.0, 0.0, -1.0]),
        ({"control_delay": {"delay": 0.1}}, None),
        ({"uneven_mass": {"fraction": 0.8, "x": -0.05, "y": 0.0, "z": 0.0, "radius": 0.018}}, [0.0, 0.0, -1.0]),
        pytest.param({"strain_stiffening": {"coefficient": 170.0}}, [0.0, 0.0, 1.0], marks=pytest.mark.slow),
        pytest.param({"tension_compression_asymmetry": {"change": -0.333}}, [0.0, 0.0, 1.0], marks=pytest.mark.slow),
        pytest.param({"anisotropy": {"cosine": 0.11, "sine": 0.075}}, None, marks=pytest.mark.slow),
        pytest.param({"viscoelasticity": {"ratio": 0.4, "time": 1.0}}, [0.0, 0.0, 1.0], marks=pytest.mark.slow),
        pytest.param({"plasticity": {"yield_strain": 0.01, "flow": 5.0}}, [0.0, 0.0, -1.0], marks=pytest.mark.slow),
        pytest.param({"hysteresis": {"strength": 0.5, "strain": 0.02}}, [0.0, 0.0, 1.0], marks=pytest.mark.slow),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_effects_move_a_lifted_solid(ellipsoid, effect, way):
    _, plain = ellipsoid
    _, injected = lifted(ELLIPSOID, effect)
    change = injected - plain
    assert 5e-4 < np.linalg.norm(change, axis=1).mean() < 0.15
    if way is not None:
        assert (change @ np.array(way)).mean() > 3e-4


def test_adhesion_keeps_a_lifted_sheet_lower(sheet):
    _, plain = sheet
    _, injected = lifted(SHEET, {"table_adhesion": {"strength": 35.0, "reach": 0.004}})
    assert (injected - plain)[:, 2].mean() < -5e-4


def test_bending_damping_keeps_a_lifted_sheet_from_bending(sheet):
    _, plain = sheet
    _, injected = lifted(SHEET, {"bending_damping": {"factor": 67.7}})
    assert np.linalg.norm(injected - plain, axis=1).mean() > 5e-4


@pytest.mark.parametrize(
    ("tilt", "effects", "slides"),
    [
        (0.3, {}, False),
        (0.3, {"place_dependent_friction": {"x": 0.0, "y": 0.0, "radius": 0.3, "change": -0.8}}, True),
        (0.3, {"place_dependent_friction": {"x": 2.0, "y": 0.0, "radius": 0.3, "change": -0.8}}, False),
        (0.6, {}, True),
        (0.6, {"place_dependent_friction": {"x": 0.0, "y": 0.0, "radius": 0.5, "change": 1.0}}, False),
        (0.6, {"stribeck_friction": {"rise": 1.0, "speed": 0.05}}, False),
    ],
)
def test_friction_holds_up_to_its_angle(tilt, effects, slides):
    """Friction of 0.5 holds up to atan 0.5 = 0.46 rad; injected friction changes that angle."""
    handled = HandledBody(make_body(SHEET, 0), {"gravity_tilt": {"about_x": tilt, "about_y": 0.0}, **effects})
    before = handled.points[:, 1].mean()
    handled.advance(lambda _: at(np.zeros((1, 3))), 0.3)
    moved = handled.points[:, 1].mean() - before
    assert moved > 0.01 if slides else abs(moved) < 1e-3


def test_plastic_stretch_stays_when_the_load_is_gone():
    """MuJoCo's elasticity takes its rest lengths from where the flow writes them."""
    engine = FlexEngine(make_body(SHEET, 0), step=2e-4, pressing=0, folding=False)
    engine.set_gravity(np.zeros(3))
    engine.set_damping(20.0)
    width = np.ptp(engine.positions[:, 0])
    engine.edge_rest_lengths[:] *= 1.05
    for _ in range(2000):
        engine.step()
    assert np.ptp(engine.positions[:, 0]) == pytest.approx(1.05 * width, rel=5e-3)


def test_a_body_that_diverges_is_one_error_and_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    engine = FlexEngine(make_body(SHEET, 0), step=0.0004, pressing=0, folding=False)
    engine.step()
    engine.step()
    engine.forces[:] = 1e30
    with pytest.raises(SimulationError, match=r"diverged at t=0\.001 s; inject a smaller effect"):
        engine.step()
    assert not list(tmp_path.iterdir())
