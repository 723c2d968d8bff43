"""Kernels that find the pairs of nodes that may collide (docs/notes/self_collision.md).

Nodes are grouped into clusters that lie together at rest, and so always. In every frame a cluster gets a box around its
positions and one around its velocities, per lane; pairs are looked at one by one only where boxes may meet, eight
rollouts at once. Pairs are first marked and counted, then listed.
"""

import math

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.simulation.collision.self_collision import PairArrays, any_positive, difference

REST_RATIO = 0.5 * math.pi
"""Pairs nearer at rest than this times their collision distance never collide. It is arc over chord of the tightest
fold: a half circle whose sides are a collision distance apart."""

PATH_TOLERANCE = 0.5
"""Share of the straight path of a horizon by which a path may differ from it."""

ACCELERATION = 9.81
"""m/s^2. Relative acceleration that the search allows for besides: one node falls, the other does not."""

CLUSTER_SIZE = 32
"""Most nodes of a cluster: the bits of a mark."""

NOWHERE = 1.0e18
"""Metres or m/s: where an empty box begins. Its square is still a float32."""

ROUNDING = 1.0001
"""Boxes extend this much farther than the pairs in them, so that no pair is lost to rounding."""


@wp.struct
class ClusterArrays:
    """Nodes in the order of their clusters."""

    nodes: wp.array(dtype=int)
    """[N]."""
    rest_positions: wp.array(dtype=wp.vec3)
    """[N] metres, in the same order."""
    starts: wp.array(dtype=int)
    """[C + 1] first entry of each cluster."""


@wp.struct
class BoxArrays:
    """Boxes around clusters. Coordinates that are no numbers do not count."""

    centres: wp.array3d(dtype=Lanes)
    """[G, C, 3] metres."""
    halves: wp.array3d(dtype=Lanes)
    """[G, C, 3] metres, half the edges."""
    velocities: wp.array3d(dtype=Lanes)
    """[G, C, 3] m/s, centre of the box of velocities."""
    speeds: wp.array2d(dtype=Lanes)
    """[G, C] m/s, half its diagonal."""


@wp.struct
class SearchArrays:
    """What is looked for."""

    distances: wp.array(dtype=Lanes)
    """[G] metres: collision distance; 0 where a rollout has no self-collision."""
    horizon: float
    """Seconds."""


@wp.func
def tolerance(speed: float, horizon: float) -> float:
    """Metres by which the path of a pair with some relative speed may differ from the straight one."""
    return PATH_TOLERANCE * horizon * speed + 0.5 * ACCELERATION * horizon * horizon


@wp.func
def candidates(
    dx: Lanes,
    dy: Lanes,
    dz: Lanes,
    ux: Lanes,
    uy: Lanes,
    uz: Lanes,
    squared_rest: float,
    distance: Lanes,
    horizon: float,
) -> Lanes:
    """The collision distance where a pair may collide within the horizon, else 0 (also for NaN), metres.

    It may if on straight paths, from d apart with the relative velocity u, it comes within distance + tolerance.
    """
    result = Lanes()
    for lane in range(LANES):
        squared_length = dx[lane] * dx[lane] + dy[lane] * dy[lane] + dz[lane] * dz[lane]
        parting = dx[lane] * ux[lane] + dy[lane] * uy[lane] + dz[lane] * uz[lane]
        squared_speed = ux[lane] * ux[lane] + uy[lane] * uy[lane] + uz[lane] * uz[lane]
        time = wp.clamp(-parting / wp.max(squared_speed, 1.0e-18), 0.0, horizon)
        nearest = squared_length + time * (2.0 * parting + time * squared_speed)
        within = distance[lane] + tolerance(wp.sqrt(squared_speed), horizon)
        apart_at_rest = REST_RATIO * REST_RATIO * distance[lane] * distance[lane]
        holds = wp.step(nearest - within * within) * wp.step(apart_at_rest - squared_rest)
        result[lane] = wp.where(holds > 0.0, distance[lane], 0.0)
    return result


@wp.func
def search_distance(wx: Lanes, wy: Lanes, wz: Lanes, speed: Lanes, distance: Lanes, horizon: float) -> Lanes:
    """Metres within which nodes of two boxes may be candidates; 0 for a rollout without self-collision.

    w is the difference of the mean velocities, `speed` what single nodes may add to it, m/s.
    """
    metres = Lanes()
    for lane in range(LANES):
        fastest = wp.sqrt(wx[lane] * wx[lane] + wy[lane] * wy[lane] + wz[lane] * wz[lane]) + speed[lane]
        farthest = horizon * fastest + tolerance(fastest, horizon)
        metres[lane] = wp.step(-distance[lane]) * ROUNDING * (distance[lane] + farthest)
    return metres


@wp.func
def gap(offset: Lanes, halves: Lanes) -> Lanes:
    """Distance between two boxes along one axis, metres, from that of their centres and half their edges."""
    metres = Lanes()
    for lane in range(LANES):
        metres[lane] = wp.max(wp.abs(offset[lane]) - halves[lane], 0.0)
    return metres


@wp.func
def any_within(x: Lanes, y: Lanes, z: Lanes, metres: Lanes) -> bool:
    """Whether a vector is shorter than some metres in some rollout."""
    within = 0
    for lane in range(LANES):
        squared_length = x[lane] * x[lane] + y[lane] * y[lane] + z[lane] * z[lane]
        within = within | wp.where(squared_length < metres[lane] * metres[lane], 1, 0)
    return within > 0


@wp.func
def clusters_meet(group: int, cluster: int, partner: int, boxes: BoxArrays, distance: Lanes, horizon: float) -> bool:
    """Whether nodes of two clusters may be candidates in some rollout."""
    dx, dy, dz = difference(group, cluster, partner, boxes.centres)
    wx, wy, wz = difference(group, cluster, partner, boxes.velocities)
    speed = boxes.speeds[group, partner] + boxes.speeds[group, cluster]
    return any_within(
        gap(dx, boxes.halves[group, partner, 0] + boxes.halves[group, cluster, 0]),
        gap(dy, boxes.halves[group, partner, 1] + boxes.halves[group, cluster, 1]),
        gap(dz, boxes.halves[group, partner, 2] + boxes.halves[group, cluster, 2]),
        search_distance(wx, wy, wz, speed, distance, horizon),
    )


@wp.kernel(enable_backward=False)
def bound_clusters(
    clusters: ClusterArrays, positions: wp.array3d(dtype=Lanes), velocities: wp.array3d(dtype=Lanes), boxes: BoxArrays
):
    """Boxes of one cluster; dim = (G, C)."""
    group, cluster = wp.tid()
    squared = Lanes()
    for axis in range(3):
        low = Lanes(NOWHERE)
        high = Lanes(-NOWHERE)
        slow = Lanes(NOWHERE)
        fast = Lanes(-NOWHERE)
        for entry in range(clusters.starts[cluster], clusters.starts[cluster + 1]):
            position = positions[group, clusters.nodes[entry], axis]
            velocity = velocities[group, clusters.nodes[entry], axis]
            for lane in range(LANES):
                # wp.min and wp.max drop a first argument that is no number.
                low[lane] = wp.min(position[lane], low[lane])
                high[lane] = wp.max(position[lane], high[lane])
                slow[lane] = wp.min(velocity[lane], slow[lane])
                fast[lane] = wp.max(velocity[lane], fast[lane])
        boxes.centres[group, cluster, axis] = 0.5 * (low + high)
        boxes.halves[group, cluster, axis] = 0.5 * (high - low)
        boxes.velocities[group, cluster, axis] = 0.5 * (slow + fast)
        squared += 0.25 * wp.cw_mul(fast - slow, fast - slow)
    speed = Lanes()
    for lane in range(LANES):
        speed[lane] = wp.sqrt(squared[lane])
    boxes.speeds[group, cluster] = speed


@wp.func
def mark_partners(
    group: int,
    entry: int,
    partner: int,
    clusters: ClusterArrays,
    boxes: BoxArrays,
    search: SearchArrays,
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    counts: wp.array2d(dtype=int),
) -> wp.uint32:
    """A bit for each later node of a cluster with which the node at `entry` makes a candidate; counts them in rows."""
    distance = search.distances[group]
    node = clusters.nodes[entry]
    x = positions[group, node, 0]
    y = positions[group, node, 1]
    z = positions[group, node, 2]
    vx = velocities[group, node, 0]
    vy = velocities[group, node, 1]
    vz = velocities[group, node, 2]
    metres = search_distance(
        boxes.velocities[group, partner, 0] - vx,
        boxes.velocities[group, partner, 1] - vy,
        boxes.velocities[group, partner, 2] - vz,
        boxes.speeds[group, partner],
        distance,
        search.horizon,
    )
    mark = wp.uint32(0)
    if any_within(
        gap(boxes.centres[group, partner, 0] - x, boxes.halves[group, partner, 0]),
        gap(boxes.centres[group, partner, 1] - y, boxes.halves[group, partner, 1]),
        gap(boxes.centres[group, partner, 2] - z, boxes.halves[group, partner, 2]),
        metres,
    ):
        begin = clusters.starts[partner]
        for other_entry in range(wp.max(begin, entry + 1), clusters.starts[partner + 1]):
            other = clusters.nodes[other_entry]
            dx = positions[group, other, 0] - x
            dy = positions[group, other, 1] - y
            dz = positions[group, other, 2] - z
            if any_within(dx, dy, dz, metres):
                ux = velocities[group, other, 0] - vx
                uy = velocities[group, other, 1] - vy
                uz = velocities[group, other, 2] - vz
                squared_rest = wp.length_sq(clusters.rest_positions[other_entry] - clusters.rest_positions[entry])
                if any_positive(candidates(dx, dy, dz, ux, uy, uz, squared_rest, distance, search.horizon)):
                    mark |= wp.uint32(1) << wp.uint32(other_entry - begin)
                    wp.atomic_add(counts, group, wp.min(node, other), 1)
    return mark


@wp.kernel(enable_backward=False)
def mark_pairs(
    clusters: ClusterArrays,
    boxes: BoxArrays,
    search: SearchArrays,
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    marks: wp.array3d(dtype=wp.uint32),
    counts: wp.array2d(dtype=int),
):
    """Mark the pairs of one cluster with itself and those after it; dim = (G, C).

    `marks` [G, N, C] gets the bits of each entry with each cluster; `counts` [G, N] grows to the lengths of the rows.
    """
    group, cluster = wp.tid()
    for partner in range(cluster, boxes.speeds.shape[1]):
        meet = clusters_meet(group, cluster, partner, boxes, search.distances[group], search.horizon)
        for entry in range(clusters.starts[cluster], clusters.starts[cluster + 1]):
            mark = wp.uint32(0)
            if meet:
                mark = mark_partners(group, entry, partner, clusters, boxes, search, positions, velocities, counts)
            marks[group, entry, partner] = mark


@wp.kernel(enable_backward=False)
def list_pairs(
    clusters: ClusterArrays,
    marks: wp.array3d(dtype=wp.uint32),
    ends: wp.array2d(dtype=int),
    others: wp.array(dtype=int),
):
    """Write the marked pairs of one cluster into the rows of their first nodes; dim = (G, C).

    `ends` [G, N] are where the rows have got to: at first where they start.
    """
    group, cluster = wp.tid()
    for entry in range(clusters.starts[cluster], clusters.starts[cluster + 1]):
        node = clusters.nodes[entry]
        for partner in range(cluster, marks.shape[2]):
            mark = marks[group, entry, partner]
            other_entry = clusters.starts[partner]
            while mark != wp.uint32(0):
                if (mark & wp.uint32(1)) != wp.uint32(0):
                    other = clusters.nodes[other_entry]
                    slot = wp.atomic_add(ends, group, wp.min(node, other), 1)
                    others[slot] = wp.max(node, other)
                mark = mark >> wp.uint32(1)
                other_entry += 1


@wp.kernel(enable_backward=False)
def finish_rows(
    rest_positions: wp.array(dtype=wp.vec3),
    search: SearchArrays,
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    pairs: PairArrays,
):
    """Sort the row of one node and write its distances; dim = (G, N)."""
    group, node = wp.tid()
    begin = pairs.starts[group, node]
    end = pairs.starts[group, node + 1]
    for pair in range(begin, end):
        other = pairs.others[pair]
        slot = int(pair)
        while slot > begin and pairs.others[slot - 1] > other:
            pairs.others[slot] = pairs.others[slot - 1]
            slot -= 1
        pairs.others[slot] = other
    for pair in range(begin, end):
        other = pairs.others[pair]
        dx, dy, dz = difference(group, node, other, positions)
        ux, uy, uz = difference(group, node, other, velocities)
        squared_rest = wp.length_sq(rest_positions[other] - rest_positions[node])
        distance = search.distances[group]
        pairs.distances[pair] = candidates(dx, dy, dz, ux, uy, uz, squared_rest, distance, search.horizon)
