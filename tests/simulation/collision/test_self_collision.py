"""Impulses between colliding nodes: against the reference, their laws, their lanes and their gradient."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from egophys_core.lanes import LANES, Lanes, pack, unpack
from egophys_core.simulation.collision.self_collision import (
    PairArrays,
    add_contact_impulses,
    apply_changes,
    count_contacts,
)
from tests.reference.self_collision import Pair, colliding_pairs, recovery_speed
from tests.reference.self_collision import collide as reference

DISTANCE = 0.02


@wp.kernel
def count_kernel(
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    pairs: PairArrays,
    nodes: int,
    contacts: wp.array2d(dtype=Lanes),
):
    group, part = wp.tid()
    count_contacts(group, part * nodes, (part + 1) * nodes, positions, velocities, pairs, contacts)


@wp.kernel
def impulse_kernel(
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    masses: wp.array2d(dtype=Lanes),
    pairs: PairArrays,
    contacts: wp.array2d(dtype=Lanes),
    restitution: wp.array(dtype=Lanes),
    friction: wp.array(dtype=Lanes),
    nodes: int,
    changes: wp.array3d(dtype=Lanes),
):
    group, part = wp.tid()
    add_contact_impulses(
        group,
        part * nodes,
        (part + 1) * nodes,
        positions,
        velocities,
        masses,
        pairs,
        contacts,
        restitution[group],
        friction[group],
        changes,
    )


@wp.kernel
def apply_kernel(
    dt: wp.array(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    changes: wp.array3d(dtype=Lanes),
    nodes: int,
    collided: wp.array3d(dtype=Lanes),
):
    group, part = wp.tid()
    apply_changes(group, part * nodes, (part + 1) * nodes, dt[group], velocities, changes, collided)


class Collision:
    """K states of N nodes and the kernels on them."""

    def __init__(self, positions, velocities, masses, pairs, *, restitution, friction, gradient=False):
        """`pairs` is a list of (i, j, [K] distances); everything else has K rows."""
        self.rollouts, self.nodes = positions.shape[:2]
        self.pairs = pair_arrays(self.nodes, self.rollouts, pairs)

        def lanes(values):
            return wp.array(pack(np.asarray(values)), dtype=Lanes, device="cpu", requires_grad=gradient)

        self.positions, self.velocities, self.masses = lanes(positions), lanes(velocities), lanes(masses)
        self.restitution, self.friction = lanes(restitution), lanes(friction)
        self.dt = lanes(np.full(self.rollouts, 1e-3))
        self.contacts = wp.zeros(self.masses.shape, dtype=Lanes, device="cpu")
        self.changes = wp.zeros_like(self.velocities)
        self.collided = wp.zeros_like(self.velocities)

    def run(self, *, parts: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Contacts [K, N] and velocities [K, N, 3]; the nodes shared among so many threads per group."""
        dim, share = (len(self.dt), parts), self.nodes // parts
        state = [self.positions, self.velocities]
        wp.launch(count_kernel, dim=dim, inputs=[*state, self.pairs, share, self.contacts], device="cpu")
        numbers = [self.restitution, self.friction]
        wp.launch(
            impulse_kernel,
            dim=dim,
            inputs=[*state, self.masses, self.pairs, self.contacts, *numbers, share, self.changes],
            device="cpu",
        )
        inputs = [self.dt, self.velocities, self.changes, share, self.collided]
        wp.launch(apply_kernel, dim=dim, inputs=inputs, device="cpu")
        return unpack(self.contacts.numpy(), self.rollouts), unpack(self.collided.numpy(), self.rollouts)


def pair_arrays(nodes: int, rollouts: int, pairs) -> PairArrays:
    """Rows from (i, j, [K] distances)."""
    listed = sorted(pairs, key=lambda pair: pair[:2])
    distances = pack(np.array([pair[2] for pair in listed], np.float32).reshape(-1, rollouts).T)
    groups = len(distances)
    rows = np.searchsorted([pair[0] for pair in listed], np.arange(nodes + 1))
    arrays = PairArrays()
    arrays.count = groups * len(listed)
    arrays.starts = wp.array(rows + len(listed) * np.arange(groups)[:, None], dtype=int, device="cpu")
    arrays.others = wp.array([pair[1] for pair in listed] * groups, dtype=int, device="cpu")
    arrays.distances = wp.array(distances.reshape(-1, LANES), dtype=Lanes, device="cpu")
    return arrays


def random_case(seed: int, *, rollouts: int = 11, nodes: int = 12):
    """Nodes in a small ball, all moving, most pairs listed for most rollouts."""
    generator = np.random.default_rng(seed)
    positions = generator.normal(0, 0.01, (rollouts, nodes, 3)).astype(np.float32)
    velocities = generator.normal(0, 0.3, positions.shape).astype(np.float32)
    masses = generator.uniform(0.1, 1.0, (rollouts, nodes)).astype(np.float32)
    pairs = [
        (i, j, (DISTANCE * (generator.random(rollouts) < 0.7)).astype(np.float32))
        for i in range(nodes)
        for j in range(i + 1, nodes)
        if generator.random() < 0.8
    ]
    numbers = {
        "restitution": np.linspace(0, 1, rollouts, dtype=np.float32),
        "friction": generator.uniform(0, 1, rollouts).astype(np.float32),
    }
    return positions, velocities, masses, pairs, numbers


def of_rollout(pairs, row: int) -> list[Pair]:
    return [(i, j, float(distances[row])) for i, j, distances in pairs]


@pytest.mark.parametrize("seed", range(5))
def test_velocities_are_those_of_the_reference(seed):
    positions, velocities, masses, pairs, numbers = random_case(seed)
    contacts, collided = Collision(positions, velocities, masses, pairs, **numbers).run()
    assert contacts.max() >= 4
    for row in range(len(positions)):
        expected = reference(
            positions[row],
            velocities[row],
            masses[row],
            of_rollout(pairs, row),
            restitution=numbers["restitution"][row],
            friction=numbers["friction"][row],
        )
        assert (contacts[row] == expected[0]).all()
        assert np.abs(collided[row] - expected[1]).max() < 1e-5


def head_on(velocities, *, gap=0.9 * DISTANCE, restitution=0.0, friction=0.0, distance=DISTANCE):
    """Two nodes of 0.1 and 0.3 kg on the x axis."""
    case = Collision(
        np.array([[[0, 0, 0], [gap, 0, 0]]]),
        np.array([velocities], np.float32),
        np.array([[0.1, 0.3]]),
        [(0, 1, [distance])],
        restitution=[restitution],
        friction=[friction],
    )
    return case.run()[1][0]


@pytest.mark.parametrize("restitution", [0.3, 1.0])
def test_head_on_collision_reverses_the_approach(restitution):
    after = head_on([[2.0, 0, 0], [0, 0, 0]], restitution=restitution)
    assert after[1, 0] - after[0, 0] == pytest.approx(2.0 * restitution)
    assert 0.1 * after[0] + 0.3 * after[1] == pytest.approx([0.2, 0, 0], abs=1e-7)


@pytest.mark.parametrize(("friction", "sliding"), [(0.0, 0.5), (0.1, 0.3), (1.0, 0.0)])
def test_friction_takes_mu_times_the_approach_from_the_sliding(friction, sliding):
    # The normal impulse m (1 + e) s with m the reduced mass stops sliding of mu (1 + e) s: here 0.1 * 2 m/s.
    after = head_on([[1.0, 0.3, 0.4], [0, 0, 0]], restitution=1.0, friction=friction)
    assert after[0, 1:] - after[1, 1:] == pytest.approx(sliding * np.array([0.6, 0.8]), abs=1e-6)


def test_nodes_that_touch_at_rest_stay_at_rest():
    assert not head_on(np.zeros((2, 3)), gap=DISTANCE, restitution=0.5, friction=0.5).any()


def test_nodes_that_are_too_near_part_slowly():
    after = head_on(np.zeros((2, 3)), gap=DISTANCE - 2e-4)
    assert after[1, 0] - after[0, 0] == pytest.approx(recovery_speed(2e-4), rel=1e-3)


@pytest.mark.parametrize(
    "state",
    [{"gap": 1.01 * DISTANCE}, {"gap": 0.0}, {"distance": 0.0}],
    ids=["far", "same place", "no candidate"],
)
def test_pairs_that_do_not_collide_keep_their_velocity(state):
    velocities = np.array([[1.0, 0.5, 0], [-1.0, 0, 0]], np.float32)
    assert (head_on(velocities, restitution=0.5, friction=0.5, **state) == velocities).all()


def test_three_in_a_row_come_to_rest_in_repeated_collisions():
    # Each round the middle node's halves meet the outer ones: 1 -> 2/3 of their speed, and nothing in the middle.
    velocities = np.array([[[1.0, 0, 0], [0, 0, 0], [-1.0, 0, 0]]])
    positions = np.array([[[-DISTANCE, 0, 0], [0, 0, 0], [DISTANCE, 0, 0]]]) * (1 - 1e-6)
    pairs = [(0, 1, [DISTANCE]), (1, 2, [DISTANCE])]
    for turn in range(1, 5):
        case = Collision(positions, velocities, np.ones((1, 3)), pairs, restitution=[0], friction=[0])
        contacts, velocities = case.run()
        assert contacts[0].tolist() == [1, 2, 1]
        assert velocities[0, :, 0] == pytest.approx(np.array([1, 0, -1]) * (2 / 3) ** turn, abs=1e-4)


@settings(max_examples=60, deadline=None)
@given(
    positions=arrays(np.float32, (1, 6, 3), elements=st.floats(-1 / 64, 1 / 64, width=32)),
    velocities=arrays(np.float32, (1, 6, 3), elements=st.floats(-2, 2, width=32)),
    masses=arrays(np.float32, (1, 6), elements=st.floats(0.125, 8, width=32)),
    restitution=st.floats(0, 1),
    friction=st.floats(0, 3),
)
def test_momentum_is_kept_and_energy_added_only_where_nodes_part(positions, velocities, masses, restitution, friction):
    pairs = [(i, j, [DISTANCE]) for i in range(6) for j in range(i + 1, 6)]
    case = Collision(positions, velocities, masses, pairs, restitution=[restitution], friction=[friction])
    contacts, collided = case.run()
    x, v, after, m = (each[0].astype(np.float64) for each in (positions, velocities, collided, masses))
    # Float32 rounds each of up to five impulses on a node.
    assert np.abs(m @ (after - v)).max() <= 1e-6 * (m @ (np.abs(v) + np.abs(after))).sum() + 1e-12
    # Nodes that are too near part with a speed w; that carries 1/2 m w^2 per contact, m the reduced mass of its parts.
    parting = 0.0
    for i, j, distance in colliding_pairs(x, v, of_rollout(pairs, 0)):
        length = np.linalg.norm(x[j] - x[i])
        speed = recovery_speed(distance - length)
        if speed > restitution * ((v[i] - v[j]) @ (x[j] - x[i]) / length):
            parting += 0.5 / (contacts[0, i] / m[i] + contacts[0, j] / m[j]) * speed**2
    energy = 0.5 * m @ (v**2).sum(axis=1)
    assert 0.5 * m @ (after**2).sum(axis=1) <= (energy + parting) * (1 + 1e-5) + 1e-9


@pytest.mark.parametrize("wild", [None, np.nan, np.inf])
def test_a_rollouts_velocities_do_not_depend_on_the_others(wild):
    positions, velocities, masses, pairs, numbers = random_case(7)
    if wild is not None:
        positions[3, 4:] = wild
        velocities[5, 2] = wild
    _, together = Collision(positions, velocities, masses, pairs, **numbers).run()
    for row in range(len(positions)):
        own = slice(row, row + 1)
        _, alone = Collision(
            positions[own],
            velocities[own],
            masses[own],
            [(i, j, distances[own]) for i, j, distances in pairs],
            **{name: values[own] for name, values in numbers.items()},
        ).run()
        if wild is None or row not in (3, 5):
            assert np.isfinite(alone).all()
            assert np.array_equal(together[row], alone[0])


def test_a_thread_per_node_does_what_a_thread_per_group_does():
    case = random_case(8)
    whole, split = (Collision(*case[:4], **case[4]).run(parts=parts) for parts in (1, 12))
    assert np.array_equal(whole[0], split[0])
    assert np.array_equal(whole[1], split[1])


def test_a_rollout_that_has_done_its_substeps_is_left_alone():
    positions, velocities, masses, pairs, numbers = random_case(9)
    case = Collision(positions, velocities, masses, pairs, **numbers)
    moving = np.arange(len(positions)) != 4
    case.dt.assign(pack(np.where(moving, 1e-3, 0.0)))
    _, collided = case.run()
    assert (collided[4] == velocities[4]).all()
    assert (collided[moving] != velocities[moving]).any(axis=(1, 2)).all()


INPUTS = ("positions", "velocities", "masses", "restitution", "friction")


def test_gradients_agree_with_central_differences():
    # Two contacts of a node that slide, one that friction stops, one of nodes that part; none near a switch.
    distance = np.array([0.02])
    values = {
        "positions": np.array(
            [[[0, 0, 0], [0.015, 0.004, 0], [-0.006, 0.016, 0.003], [0.1, 0, 0], [0.1, 0.019, 0.002], [0.1, 0, 0.018]]]
        ),
        "velocities": np.array(
            [[[0.3, 0.4, 0.1], [-0.2, 0.1, 0.5], [0.1, -0.5, -0.4], [0, 0.8, 0], [0.01, 0, 0.02], [0.2, 0.9, 0.05]]]
        ),
        "masses": np.array([[0.2, 0.3, 0.25, 0.4, 0.15, 0.3]]),
        "restitution": np.array([0.3]),
        "friction": np.array([0.2]),
    }
    pairs = [(0, 1, distance), (0, 2, distance), (3, 4, distance), (3, 5, distance)]
    weights = np.random.default_rng(0).normal(size=(1, 6, 3))

    def loss(at: dict[str, np.ndarray]) -> float:
        numbers = {name: float(at[name][0]) for name in ("restitution", "friction")}
        state = [at[name][0] for name in INPUTS[:3]]
        return float((weights[0] * reference(*state, of_rollout(pairs, 0), **numbers)[1]).sum())

    assert len(colliding_pairs(values["positions"][0], values["velocities"][0], of_rollout(pairs, 0))) == 4
    case = Collision(
        *(values[name] for name in INPUTS[:3]),
        pairs,
        restitution=values["restitution"],
        friction=values["friction"],
        gradient=True,
    )
    with wp.Tape() as tape:
        case.run()
    # The last rollout fills the lane group: only one lane of it counts.
    seed = np.zeros(case.collided.shape + (LANES,), np.float32)
    seed[0, ..., 0] = weights[0]
    tape.backward(grads={case.collided: wp.array(seed, dtype=Lanes, device="cpu")})
    for name in INPUTS:
        got = unpack(getattr(case, name).grad.numpy(), 1)
        expected = np.zeros_like(values[name])
        for index in np.ndindex(expected.shape):
            sides = []
            for step in (1e-7, -1e-7):
                moved = {key: value.copy() for key, value in values.items()}
                moved[name][index] += step
                sides.append(loss(moved))
            expected[index] = (sides[0] - sides[1]) / 2e-7
        assert np.abs(expected).max() > 0.01, name
        assert np.abs(got - expected).max() < 1e-3 * np.abs(expected).max(), name


def test_gradients_are_finite_where_nothing_is_defined():
    # Same place, same velocity, no distance: every division has its guard.
    positions = np.zeros((1, 3, 3))
    positions[0, 2] = [0.01, 0, 0]
    velocities = np.zeros((1, 3, 3))
    velocities[0, 2] = [-1, 0, 0]
    pairs = [(0, 1, [DISTANCE]), (0, 2, [DISTANCE]), (1, 2, [0.0])]
    case = Collision(positions, velocities, np.ones((1, 3)), pairs, restitution=[0], friction=[0.5], gradient=True)
    with wp.Tape() as tape:
        case.run()
    tape.backward(grads={case.collided: wp.full_like(case.collided, Lanes(1.0))})
    for name in INPUTS:
        assert np.isfinite(getattr(case, name).grad.numpy()).all(), name
