"""The table: friction, restitution and force projection against their equations."""

import numpy as np
import pytest

from egophys_core.simulation import rollout
from tests.simulation.scenes import frame_times, idle_controls, scene

G = 9.81


@pytest.mark.parametrize(("friction", "speed"), [(0.3, 0.8), (0.6, 0.5), (1.2, 1.0)])
def test_sliding_block_stops_after_its_braking_distance(friction, speed):
    # Coulomb friction brakes with mu g: v^2 / (2 mu g), off by half a step at full speed, a share mu g dt / v.
    dt = 1 / 2000
    assert friction * G * dt / speed < 0.01
    batch = scene(
        [[0, 0, 0]],
        idle_controls(frame_times(0.4, dt)),
        ground_height=0.0,
        friction=friction,
        gravity=G,
        velocities=[[0.6 * speed, 0.8 * speed, 0]],
    )
    result = rollout(batch)
    assert (result.velocities[0, 0] == 0).all()
    travelled = result.positions[0, -1, 0]
    distance = speed**2 / (2 * friction * G)
    assert travelled[:2] == pytest.approx(distance * np.array([0.6, 0.8]), rel=0.01)
    assert travelled[2] == pytest.approx(0.0, abs=1e-6)


def test_without_friction_a_block_slides_on():
    batch = scene(
        [[0, 0, 0]],
        idle_controls(frame_times(0.5, 1 / 30)),
        ground_height=0.0,
        gravity=G,
        velocities=[[0.3, 0, 0]],
    )
    assert rollout(batch).positions[0, -1, 0] == pytest.approx([0.15, 0, 0], abs=1e-5)


@pytest.mark.parametrize("restitution", [0.0, 0.4, 0.8])
@pytest.mark.parametrize("ground", [0.0, 0.25])
def test_bounce_rises_to_the_restitution_squared_of_the_drop(restitution, ground):
    # h' = e^2 h; the touch is found within a step, so the speed is off by g dt and the height by e^2 sqrt(2 g h) dt.
    height, dt = 0.3, 1 / 2000
    batch = scene(
        [[0, 0, ground + height]],
        idle_controls(frame_times(0.75, dt)),
        ground_height=ground,
        restitution=restitution,
        gravity=G,
    )
    z = rollout(batch).positions[0, :, 0, 2] - ground
    landed = int(np.argmax(z < 1e-3))
    assert z.min() >= -1e-6
    assert landed * dt == pytest.approx(np.sqrt(2 * height / G), abs=3 * dt)
    assert z[landed:].max() == pytest.approx(restitution**2 * height, abs=2 * np.sqrt(2 * G * height) * dt)


def test_node_rests_with_its_centre_a_contact_radius_above_the_table():
    batch = scene(
        [[0, 0, 0.5]],
        idle_controls(frame_times(1.0, 1 / 60)),
        ground_height=0.1,
        contact_radius=0.03,
        gravity=G,
    )
    assert rollout(batch).positions[0, -1, 0, 2] == pytest.approx(0.13, abs=1e-6)


def test_table_pushes_up_but_does_not_pull():
    batch = scene(
        [[0, 0, 0]], idle_controls(frame_times(0.5, 1 / 60)), ground_height=0.0, velocities=[[0, 0, 0.2]], friction=1.0
    )
    assert rollout(batch).positions[0, -1, 0, 2] == pytest.approx(0.1, abs=1e-5)


def lifted_speed(height: float, share: float, *, upper: float = 1.0) -> float:
    """Vertical speed after one substep of a node that a spring from a node `upper` above it pulls with 4 - 1 N."""
    batch = scene(
        [[0, 0, height], [0, 0, height + upper]],
        idle_controls(np.array([0.0, 1 / 1000])),
        springs=[(0, 1)],
        stiffness=4.0 / (upper - 0.5),
        rest_lengths=[0.5],
        mass=0.1,
        gravity=10.0,
        ground_height=0.0,
        contact_threshold=0.01,
        ground_projection=share,
    )
    return float(rollout(batch).velocities[0, 0, 2])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_projection_takes_its_share_of_an_upward_net_force_in_the_contact_band(share):
    # F' = F - alpha max(0, F . n) n for heights in [0, delta); F = 4 N - 0.1 kg * 10 m/s^2 = 3 N.
    free = 3.0 / 0.1 / 1000
    assert lifted_speed(0.005, share) == pytest.approx((1 - share) * free, rel=1e-4, abs=1e-7)
    assert lifted_speed(0.0, share) == pytest.approx((1 - share) * free, rel=1e-4, abs=1e-7)
    assert lifted_speed(0.0101, share) == pytest.approx(free, rel=1e-4)
    assert lifted_speed(-0.001, share) == pytest.approx(free, rel=1e-4)


def test_projection_leaves_a_downward_net_force():
    batch = scene(
        [[0, 0, 0.009]],
        idle_controls(np.array([0.0, 1 / 1000])),
        gravity=10.0,
        ground_height=0.0,
        contact_threshold=0.01,
        ground_projection=1.0,
    )
    assert rollout(batch).velocities[0, 0, 2] == pytest.approx(-0.01, rel=1e-5)
