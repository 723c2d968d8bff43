"""Self-collision: impulses between nodes that are near in space but not on the object (docs/notes/self_collision.md).

A node in several contacts at once is split (Tonge, Benevolenski and Voroshilov, "Mass splitting for jitter-free
parallel rigid body simulation", ACM Transactions on Graphics 31(4), 2012): each of its c contacts is solved as if it
met a mass of m / c, then all impulses act on the whole mass, which averages its parts. So impulses need no order,
conserve momentum, and a restitution of at most 1 adds no energy.
"""

import warp as wp

from egophys_core.lanes import LANES, Lanes

RECOVERY_RATE = 100.0
"""1/s. Nodes nearer than their collision distance part with this times what they lack. Stopping the approach alone
lets a layer that lies on another sink through it: the table takes up half of each impulse."""

FASTEST_RECOVERY = 0.1
"""m/s. Bounds the energy that parting adds, 1/2 m v^2, where nodes have got far into each other."""

SHORTEST_LENGTH = 1.0e-9
"""Metres. Nodes nearer than this have no line to part along and get no impulse; guards the division by the distance."""

SMALLEST_SPEED = 1.0e-9
"""m/s. Guards the division by the sliding speed: slower than this, friction stops the sliding."""


@wp.struct
class PairArrays:
    """Pairs of nodes that may collide within a frame, in rows, one row per node; each pair stands in one row."""

    starts: wp.array2d(dtype=int)
    """[G, N + 1] first entry of each node's row in the flat lists."""
    others: wp.array(dtype=int)
    """[Q] the other node, > the row's node; ascending within a row. What stands in no row means nothing."""
    distances: wp.array(dtype=Lanes)
    """[Q] metres: nodes nearer than this collide; 0 where the pair is no candidate of a rollout."""
    count: int
    """Q, or 0 where there are no pairs."""


# Functions of many steps fill one or two results in one loop over the lanes: the compiler turns those into vector
# instructions. With a select in it, or three results, the impulse took three times as long.


@wp.func
def difference(group: int, node: int, other: int, values: wp.array3d(dtype=Lanes)):
    """x, y, z of the other node less those of the node."""
    return (
        values[group, other, 0] - values[group, node, 0],
        values[group, other, 1] - values[group, node, 1],
        values[group, other, 2] - values[group, node, 2],
    )


@wp.func
def dot(ax: Lanes, ay: Lanes, az: Lanes, bx: Lanes, by: Lanes, bz: Lanes) -> Lanes:
    """Scalar product per lane."""
    product = Lanes()
    for lane in range(LANES):
        product[lane] = ax[lane] * bx[lane] + ay[lane] * by[lane] + az[lane] * bz[lane]
    return product


@wp.func
def any_positive(values: Lanes) -> bool:
    """Whether a number is positive in some rollout."""
    positive = 0
    for lane in range(LANES):
        positive = positive | wp.where(values[lane] > 0.0, 1, 0)
    return positive > 0


@wp.func
def any_near(dx: Lanes, dy: Lanes, dz: Lanes, distance: Lanes) -> bool:
    """Whether the pair may be nearer than its distance in some rollout; `colliding` decides for each."""
    near = 0
    for lane in range(LANES):
        squared_length = dx[lane] * dx[lane] + dy[lane] * dy[lane] + dz[lane] * dz[lane]
        near = near | wp.where(squared_length < 1.0001 * distance[lane] * distance[lane], 1, 0)
    return near > 0


@wp.func
def colliding(squared_length: Lanes, approach: Lanes, distance: Lanes) -> Lanes:
    """1 where a pair is nearer than its distance and does not part fast enough, else 0 (also for NaN).

    Args:
        squared_length: d.d, d the vector from one node to the other, m^2.
        approach: d.u, u the velocity of the other node relative to the one, m^2/s; negative when they come nearer.
        distance: metres.
    """
    collides = Lanes()
    for lane in range(LANES):
        apart = wp.step(SHORTEST_LENGTH * SHORTEST_LENGTH - squared_length[lane])
        length = wp.sqrt(wp.max(squared_length[lane], SHORTEST_LENGTH * SHORTEST_LENGTH))
        near = wp.step(length - distance[lane])
        recovery = wp.min(RECOVERY_RATE * (distance[lane] - length), FASTEST_RECOVERY)
        collides[lane] = apart * near * wp.step(approach[lane] - recovery * length)
    return collides


@wp.func
def impulse_coefficients(
    squared_length: Lanes,
    approach: Lanes,
    squared_speed: Lanes,
    distance: Lanes,
    inverse_mass: Lanes,
    restitution: Lanes,
    friction: Lanes,
):
    """A in kg and B in kg/s of the impulse A u - B d on a node whose partner is d away and moves with u against it.

    With n = d / |d|, the approach speed s = -n.u, the sliding velocity t = u + s n and the reduced mass m, the
    normal impulse P = m (s + max(e s, recovery)) acts along -n and friction min(mu P, m |t|) along t.
    """
    along_velocity = Lanes()
    along_line = Lanes()
    for lane in range(LANES):
        length = wp.sqrt(wp.max(squared_length[lane], SHORTEST_LENGTH * SHORTEST_LENGTH))
        inverse_length = 1.0 / length
        speed = -approach[lane] * inverse_length
        mass = 1.0 / inverse_mass[lane]
        recovery = wp.min(RECOVERY_RATE * (distance[lane] - length), FASTEST_RECOVERY)
        normal = mass * (speed + wp.max(restitution[lane] * speed, recovery))
        sliding = wp.sqrt(wp.max(squared_speed[lane] - speed * speed, SMALLEST_SPEED * SMALLEST_SPEED))
        rubbing = wp.min(friction[lane] * normal / sliding, mass)
        along_velocity[lane] = rubbing
        along_line[lane] = (normal - rubbing * speed) * inverse_length
    return along_velocity, along_line


@wp.func
def split_inverse_mass(contacts: Lanes, inverse_mass: Lanes) -> Lanes:
    """1/kg of one of the parts of a node: as many as it has contacts, at least one."""
    inverse = Lanes()
    for lane in range(LANES):
        inverse[lane] = wp.max(contacts[lane], 1.0) * inverse_mass[lane]
    return inverse


@wp.func
def count_contacts(
    group: int,
    first: int,
    last: int,
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    pairs: PairArrays,
    contacts: wp.array2d(dtype=Lanes),
):
    """Add 1 to `contacts` [G, N] of both nodes of each colliding pair in the rows of first..last-1."""
    starts = pairs.starts
    others = pairs.others
    distances = pairs.distances
    for node in range(first, last):
        for pair in range(starts[group, node], starts[group, node + 1]):
            other = others[pair]
            dx, dy, dz = difference(group, node, other, positions)
            if any_near(dx, dy, dz, distances[pair]):
                ux, uy, uz = difference(group, node, other, velocities)
                collides = colliding(dot(dx, dy, dz, dx, dy, dz), dot(dx, dy, dz, ux, uy, uz), distances[pair])
                contacts[group, node] += collides
                contacts[group, other] += collides


@wp.func
def add_contact_impulses(
    group: int,
    first: int,
    last: int,
    positions: wp.array3d(dtype=Lanes),
    velocities: wp.array3d(dtype=Lanes),
    masses: wp.array2d(dtype=Lanes),
    pairs: PairArrays,
    contacts: wp.array2d(dtype=Lanes),
    restitution: Lanes,
    friction: Lanes,
    changes: wp.array3d(dtype=Lanes),
):
    """Add to `changes` [G, N, 3], m/s, what the colliding pairs in the rows of first..last-1 give to both nodes.

    `velocities` are those after all forces of the substep, `contacts` what `count_contacts` counted for them in all
    rows.
    """
    starts = pairs.starts
    others = pairs.others
    distances = pairs.distances
    for node in range(first, last):
        if any_positive(contacts[group, node]):
            inverse_mass = wp.cw_div(Lanes(1.0), masses[group, node])
            split_inverse = split_inverse_mass(contacts[group, node], inverse_mass)
            # Sums over a loop may only be added to something: Warp's adjoint does not keep their value.
            change_x = Lanes()
            change_y = Lanes()
            change_z = Lanes()
            for pair in range(starts[group, node], starts[group, node + 1]):
                other = others[pair]
                dx, dy, dz = difference(group, node, other, positions)
                if any_near(dx, dy, dz, distances[pair]):
                    ux, uy, uz = difference(group, node, other, velocities)
                    squared_length = dot(dx, dy, dz, dx, dy, dz)
                    approach = dot(dx, dy, dz, ux, uy, uz)
                    collides = colliding(squared_length, approach, distances[pair])
                    other_inverse = wp.cw_div(Lanes(1.0), masses[group, other])
                    rubbing, pressing = impulse_coefficients(
                        squared_length,
                        approach,
                        dot(ux, uy, uz, ux, uy, uz),
                        distances[pair],
                        split_inverse + split_inverse_mass(contacts[group, other], other_inverse),
                        restitution,
                        friction,
                    )
                    along_velocity = wp.cw_mul(collides, rubbing)
                    along_line = wp.cw_mul(collides, pressing)
                    px = wp.cw_mul(along_velocity, ux) - wp.cw_mul(along_line, dx)
                    py = wp.cw_mul(along_velocity, uy) - wp.cw_mul(along_line, dy)
                    pz = wp.cw_mul(along_velocity, uz) - wp.cw_mul(along_line, dz)
                    change_x += wp.cw_mul(inverse_mass, px)
                    change_y += wp.cw_mul(inverse_mass, py)
                    change_z += wp.cw_mul(inverse_mass, pz)
                    changes[group, other, 0] -= wp.cw_mul(other_inverse, px)
                    changes[group, other, 1] -= wp.cw_mul(other_inverse, py)
                    changes[group, other, 2] -= wp.cw_mul(other_inverse, pz)
            changes[group, node, 0] += change_x
            changes[group, node, 1] += change_y
            changes[group, node, 2] += change_z


@wp.func
def apply_changes(
    group: int,
    first: int,
    last: int,
    dt: Lanes,
    velocities: wp.array3d(dtype=Lanes),
    changes: wp.array3d(dtype=Lanes),
    collided: wp.array3d(dtype=Lanes),
):
    """Write velocities + changes of nodes first..last-1 into `collided`, which may be the same array as either.

    A rollout that has done its substeps (dt = 0) is left alone, however many more its lane group does.
    """
    moving = Lanes()
    for lane in range(LANES):
        moving[lane] = wp.step(-dt[lane])
    for node in range(first, last):
        for axis in range(3):
            change = wp.cw_mul(moving, changes[group, node, axis])
            collided[group, node, axis] = velocities[group, node, axis] + change
