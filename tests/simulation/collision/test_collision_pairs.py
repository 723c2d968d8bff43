"""Finding pairs that may collide: against the reference, in wild states, and alone in their lane."""

import numpy as np
import pytest
import warp as wp

from egophys_core.errors import SimulationError
from egophys_core.lanes import LANES, Lanes, pack
from egophys_core.simulation.collision.collision_pairs import PairFinder, clusters_of, find_pairs
from egophys_core.simulation.collision.pair_search import CLUSTER_SIZE
from egophys_core.simulation.collision.self_collision import PairArrays
from tests.reference.self_collision import spare_distances

HORIZON = 1 / 30
DISTANCE = 0.012


def crumpled_sheets(rollouts: int, *, nodes: int = 120, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rest positions, positions and velocities of a sheet that lies folded and crumpled, otherwise in each rollout."""
    generator = np.random.default_rng(seed)
    rest = np.zeros((nodes, 3), np.float32)
    rest[:, :2] = generator.uniform(0, 0.012 * np.sqrt(nodes), (nodes, 2))
    middle = rest[:, 0].mean() + generator.normal(0, 0.01, (rollouts, 1))
    folded = rest[:, 0] > middle
    positions = np.repeat(rest[None], rollouts, axis=0)
    positions[:, :, 0] = np.where(folded, 2 * middle - rest[:, 0], rest[:, 0])
    positions[:, :, 2] = np.where(folded, 0.015, 0.0)
    positions += generator.normal(0, 0.003, positions.shape).astype(np.float32)
    velocities = np.where(folded[..., None], [0.1, 0.0, -0.3], 0.0) + generator.normal(0, 0.05, positions.shape)
    return rest, positions, velocities.astype(np.float32)


def found(pairs: PairArrays, rollouts: int) -> list[dict[tuple[int, int], float]]:
    """Collision distance of each candidate (i, j) of each rollout."""
    starts, others, distances = pairs.starts.numpy(), pairs.others.numpy(), pairs.distances.numpy()
    listed: list[dict[tuple[int, int], float]] = [{} for _ in range(rollouts)]
    for rollout, each in enumerate(listed):
        group, lane = divmod(rollout, LANES)
        for node, (first, last) in enumerate(zip(starts[group], starts[group, 1:], strict=False)):
            for other, distance in zip(others[first:last], distances[first:last, lane], strict=True):
                if distance > 0:
                    each[node, int(other)] = float(distance)
    return listed


def find(positions, velocities, distances, rest) -> list[dict[tuple[int, int], float]]:
    pairs = find_pairs(positions, velocities, horizon=HORIZON, distances=distances, rest_positions=rest, device="cpu")
    return found(pairs, len(positions))


@pytest.mark.parametrize("seed", range(3))
def test_candidates_are_those_of_the_reference(seed):
    rollouts = 11
    rest, positions, velocities = crumpled_sheets(rollouts, seed=seed)
    distances = np.linspace(0.0, 0.02, rollouts)
    listed = find(positions, velocities, distances, rest)
    assert not listed[0]
    for row in range(1, rollouts):
        spare = spare_distances(positions[row], velocities[row], rest, distances[row], HORIZON)
        # Float32 carries 6e-8 of some decimetres.
        surely = {pair for pair, metres in spare.items() if metres > 1e-6}
        perhaps = {pair for pair, metres in spare.items() if metres > -1e-6}
        assert len(surely) > 50
        assert surely <= listed[row].keys() <= perhaps
        assert set(listed[row].values()) == {float(np.float32(distances[row]))}


def test_rows_ascend_and_hold_each_pair_once():
    rest, positions, velocities = crumpled_sheets(3)
    pairs = find_pairs(
        positions, velocities, horizon=HORIZON, distances=np.full(3, DISTANCE), rest_positions=rest, device="cpu"
    )
    starts, others = pairs.starts.numpy(), pairs.others.numpy()
    assert starts.shape == (1, len(rest) + 1)
    assert starts[0, 0] == 0
    assert 0 < starts[0, -1] <= pairs.count == len(others) == len(pairs.distances)
    for node in range(len(rest)):
        row = others[starts[0, node] : starts[0, node + 1]]
        assert (row > node).all()
        assert (np.diff(row) > 0).all()
    assert (pairs.distances.numpy()[: starts[0, -1]] > 0).any(axis=1).all()


def test_a_rollouts_candidates_do_not_depend_on_the_others():
    rest, positions, velocities = crumpled_sheets(10)
    distances = np.linspace(0.006, 0.018, 10)
    together = find(positions, velocities, distances, rest)
    for row in range(10):
        (alone,) = find(positions[row : row + 1], velocities[row : row + 1], distances[row : row + 1], rest)
        assert together[row] == alone


def test_the_order_of_the_nodes_does_not_matter():
    rest, positions, velocities = crumpled_sheets(2)
    order = np.random.default_rng(5).permutation(len(rest))
    straight = find(positions, velocities, np.full(2, DISTANCE), rest)
    shuffled = find(positions[:, order], velocities[:, order], np.full(2, DISTANCE), rest[order])
    for one, other in zip(straight, shuffled, strict=True):
        assert one.keys() == {tuple(sorted((int(order[i]), int(order[j])))) for i, j in other}


def test_a_flat_sheet_at_rest_has_no_candidates():
    side, spacing = 12, 0.015
    x, y = np.meshgrid(np.arange(side) * spacing, np.arange(side) * spacing)
    rest = np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=1).astype(np.float32)
    pairs = find_pairs(
        rest[None], 0 * rest[None], horizon=HORIZON, distances=np.array([0.012]), rest_positions=rest, device="cpu"
    )
    assert not pairs.starts.numpy().any()


def test_all_nodes_in_one_place_are_all_listed():
    nodes = 300
    rest = np.zeros((nodes, 3), np.float32)
    rest[:, 0] = np.arange(nodes)
    pairs = find_pairs(
        0 * rest[None], 0 * rest[None], horizon=HORIZON, distances=np.array([0.01]), rest_positions=rest, device="cpu"
    )
    assert pairs.starts.numpy()[0, -1] == nodes * (nodes - 1) // 2


@pytest.mark.parametrize("wild", [np.nan, np.inf, -np.inf, 1e30, -3e38])
@pytest.mark.parametrize("where", ["positions", "velocities"])
def test_a_diverged_rollout_disturbs_nobody(wild, where):
    rest, positions, velocities = crumpled_sheets(9)
    distances = np.full(9, DISTANCE)
    calm = find(positions, velocities, distances, rest)
    {"positions": positions, "velocities": velocities}[where][4, ::3] = wild
    listed = find(positions, velocities, distances, rest)
    assert listed[:4] + listed[5:] == calm[:4] + calm[5:]


@pytest.mark.parametrize("seed", range(4))
def test_nodes_without_numbers_are_left_out_and_the_others_found(seed):
    rest, positions, velocities = crumpled_sheets(1, seed=seed)
    (calm,) = find(positions, velocities, np.array([DISTANCE]), rest)
    lost = np.random.default_rng(seed).random(len(rest)) < 0.7
    positions[0, lost] = np.nan
    (listed,) = find(positions, velocities, np.array([DISTANCE]), rest)
    assert listed == {pair: metres for pair, metres in calm.items() if not lost[list(pair)].any()}
    assert listed


def test_controller_points_after_the_nodes_are_left_out():
    rest, positions, velocities = crumpled_sheets(2)
    (expected,) = find(positions[:1], velocities[:1], np.array([DISTANCE]), rest)
    state = [
        wp.array(pack(np.concatenate([each[:1], 0 * each[:1, :5]], axis=1)), dtype=Lanes, device="cpu")
        for each in (positions, velocities)
    ]
    finder = PairFinder(rest, np.array([DISTANCE]), "cpu")
    assert finder.find(*state, HORIZON)
    assert found(finder.pairs, 1) == [expected]


def test_searches_after_each_other_find_what_each_finds_alone():
    """Also in more or fewer pairs than before, in other arrays, over another horizon, and after none were found."""
    rest, positions, velocities = crumpled_sheets(2)
    finder = PairFinder(rest, np.array([DISTANCE]), "cpu")
    flat = np.repeat(rest[None], 2, axis=0)
    for places, row, horizon in (
        (flat, 0, HORIZON),
        (positions, 0, HORIZON),
        (positions, 1, 2 * HORIZON),
        (flat, 1, HORIZON),
        (positions, 0, HORIZON),
    ):
        state = [each[row : row + 1] for each in (places, velocities if places is positions else 0 * velocities)]
        alone = find_pairs(*state, horizon=horizon, distances=np.array([DISTANCE]), rest_positions=rest, device="cpu")
        on_device = [wp.array(pack(each), dtype=Lanes, device="cpu") for each in state]
        (expected,) = found(alone, 1)
        assert finder.find(*on_device, horizon) == bool(expected) == (places is positions)
        assert found(finder.pairs, 1) == [expected]


def test_a_tape_does_not_record_the_search():
    rest, positions, velocities = crumpled_sheets(1)
    with wp.Tape() as tape:
        find(positions, velocities, np.array([DISTANCE]), rest)
    assert not tape.launches


@pytest.mark.parametrize("nodes", [1, CLUSTER_SIZE, CLUSTER_SIZE + 1, 500])
def test_clusters_hold_every_node_once_and_few_each(nodes):
    rest = np.random.default_rng(nodes).normal(size=(nodes, 3))
    members = clusters_of(rest)
    assert sorted(np.concatenate(members).tolist()) == list(range(nodes))
    assert max(map(len, members)) <= CLUSTER_SIZE


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": np.zeros((1, 3, 3), np.float32)}, "positions must be"),
        ({"velocities": np.zeros((2, 4, 3), np.float32)}, "velocities must be"),
        ({"rest_positions": np.full((4, 3), np.nan)}, "rest positions"),
        ({"distances": np.array([-0.01])}, "collision distances"),
        ({"distances": np.array([np.nan])}, "collision distances"),
    ],
)
def test_wrong_input_is_refused(changes, message):
    arguments = {
        "positions": np.zeros((1, 4, 3), np.float32),
        "velocities": np.zeros((1, 4, 3), np.float32),
        "distances": np.array([0.01]),
        "rest_positions": np.zeros((4, 3)),
    }
    with pytest.raises(SimulationError, match=message):
        find_pairs(**{**arguments, **changes}, horizon=HORIZON, device="cpu")
