"""How the material frames of a rod are turned about its line, and how that bends the line.

What was kept on a coil has an intrinsic curvature, to one of its own sides. Where that side points is told by its
clamps, and by twist, which bends a line that is bent already, too. Twist is settled long before a line has moved
(Bergou et al., ACM Trans. Graphics 27 (2008) 63): at the start of each frame of the rollout the material frames are
turned to where they are at rest.

Piece j has a material frame, turned by an angle theta_j from the reference frame that parallel transport of the axis,
by the smallest rotation to the direction of the piece, gives it. From piece to piece that reference turns about the
line, too, at node i by m_i: minus the solid angle between the axis and both pieces (van Oosterom and Strackee, IEEE
Trans. Biomed. Eng. 30 (1983) 125). What is least is the sum over nodes of

    GJ (theta_i+1 - theta_i + m_i)^2 / 2H - EI t . k((theta_i + theta_i+1) / 2)

with pieces named by the node after them, t the discrete curvature and H as in `rod_bending`, and k the intrinsic
curvature, 1/m, in a material frame at that angle. What a clamp holds is not turned but by how the far one took hold:
two points on a line do not tell that it rolls. The axis is that of the straight rod of the twin, in each of its
records, so what a gripper that does not turn holds has one side up in all of them.
"""

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import StateArrays

ANGLE, TURNED, ALONG, ACROSS, TWISTING, PIVOT, BESIDE, STEP = 0, 1, 2, 3, 4, 5, 6, 7
"""Numbers of a material frame, by node: theta; m; EI t . k at angles of 0 and of 90 degrees; GJ / H; and of Newton's
method a row of the elimination and the step."""

FRAME_NUMBERS = 8

ROUNDS = 4
"""Of Newton's method in a frame of the rollout, from the angles of the last one."""

LEAST_SUM = 0.1
"""Of 1 and the cosine between the axis and the line: no smallest rotation turns a direction into its opposite."""


@wp.struct
class RodArrays:
    """Rods, all `Lanes`."""

    bend: int
    """1 if the objects are rods, else 0."""
    rigidity: wp.array(dtype=Lanes)
    """[G] EI, N m^2."""
    viscosity: wp.array(dtype=Lanes)
    """[G] N m^2 s."""
    torsion: wp.array(dtype=Lanes)
    """[G] GJ, N m^2."""
    far_clamps: wp.array(dtype=Lanes)
    """[G] 1 if a clamp holds the far end, else 0."""
    curvatures: wp.array3d(dtype=Lanes)
    """[G, N, 3] the intrinsic curvature at the nodes on the straight rod, 1/m."""
    far_rolls: wp.array(dtype=Lanes)
    """[G] radians, the angle of the last piece where a far clamp holds it."""
    axes: wp.array2d(dtype=Lanes)
    """[G, 3] direction of the straight rod."""
    lengths: wp.array2d(dtype=Lanes)
    """[G, N - 1] metres of the pieces."""
    forces: wp.array3d(dtype=Lanes)
    """[G, N, 3] newtons of the intrinsic curvature and of twist, held for a frame of the rollout."""
    material_frames: wp.array3d(dtype=Lanes)
    """[G, N, FRAME_NUMBERS] how material frames are turned, from one frame of the rollout to the next."""


@wp.func
def three(group: int, lane: int, values: wp.array2d(dtype=Lanes)) -> wp.vec3:
    """Three numbers of a lane."""
    return wp.vec3(values[group, 0][lane], values[group, 1][lane], values[group, 2][lane])


@wp.func
def three_at(group: int, node: int, lane: int, values: wp.array3d(dtype=Lanes)) -> wp.vec3:
    """Three numbers of a node in a lane."""
    return wp.vec3(values[group, node, 0][lane], values[group, node, 1][lane], values[group, node, 2][lane])


@wp.func
def edge(group: int, node: int, lane: int, positions: wp.array3d(dtype=Lanes)) -> wp.vec3:
    """The edge of the line that ends at a node, metres."""
    return wp.vec3(
        positions[group, node, 0][lane] - positions[group, node - 1, 0][lane],
        positions[group, node, 1][lane] - positions[group, node - 1, 1][lane],
        positions[group, node, 2][lane] - positions[group, node - 1, 2][lane],
    )


@wp.func
def parallel_transport(axis: wp.vec3, direction: wp.vec3, across: wp.vec3) -> wp.vec3:
    """What is across the axis after the smallest rotation of the axis into a direction (Rodrigues' formula)."""
    return across - wp.dot(across, direction) / wp.max(1.0 + wp.dot(axis, direction), LEAST_SUM) * (axis + direction)


@wp.func
def moment_about(group: int, node: int, lane: int, angle: float, material: wp.array3d(dtype=Lanes)) -> float:
    """N m, by which the intrinsic curvature resists a growing angle at a node."""
    along = material[group, node, ALONG][lane]
    return along * wp.sin(angle) - material[group, node, ACROSS][lane] * wp.cos(angle)


@wp.func
def stiffness_about(group: int, node: int, lane: int, angle: float, material: wp.array3d(dtype=Lanes)) -> float:
    """N m, a quarter of the slope of that moment, so far as it is one of a minimum."""
    along = material[group, node, ALONG][lane]
    return 0.25 * wp.max(along * wp.cos(angle) + material[group, node, ACROSS][lane] * wp.sin(angle), 0.0)


@wp.func
def step_of_newton(group: int, lane: int, nodes: int, last: int, material: wp.array3d(dtype=Lanes)):
    """Bring the angles of pieces 2..last nearer to rest (elimination along the rod, then back)."""
    for piece in range(2, last + 1):
        before = piece - 1
        here = material[group, piece, ANGLE][lane]
        backward = material[group, before, ANGLE][lane]
        twisting = material[group, before, TWISTING][lane]
        bending = stiffness_about(group, before, lane, 0.5 * (backward + here), material)
        right = -twisting * (here - backward + material[group, before, TURNED][lane])
        right -= 0.5 * moment_about(group, before, lane, 0.5 * (backward + here), material)
        pivot = twisting + bending
        beside = bending - twisting
        if piece < nodes - 1:
            onward = material[group, piece + 1, ANGLE][lane]
            twisting = material[group, piece, TWISTING][lane]
            right += twisting * (onward - here + material[group, piece, TURNED][lane])
            right -= 0.5 * moment_about(group, piece, lane, 0.5 * (here + onward), material)
            pivot += twisting + stiffness_about(group, piece, lane, 0.5 * (here + onward), material)
        if piece > 2:
            share = beside / material[group, before, PIVOT][lane]
            pivot -= share * beside
            right -= share * material[group, before, STEP][lane]
        material[group, piece, PIVOT][lane] = pivot
        material[group, piece, BESIDE][lane] = beside
        material[group, piece, STEP][lane] = right
    for back in range(last - 1):
        piece = last - back
        right = material[group, piece, STEP][lane]
        if back > 0:
            right -= material[group, piece + 1, BESIDE][lane] * material[group, piece + 1, STEP][lane]
        material[group, piece, STEP][lane] = right / material[group, piece, PIVOT][lane]
    for piece in range(2, last + 1):
        material[group, piece, ANGLE][lane] += material[group, piece, STEP][lane]


@wp.func
def push(group: int, node: int, lane: int, force: wp.vec3, forces: wp.array3d(dtype=Lanes)):
    """Add to the force on a node."""
    for axis in range(3):
        forces[group, node, axis][lane] += force[axis]


@wp.func
def edges_at(group: int, node: int, lane: int, axis: wp.vec3, curvature: wp.vec3, positions: wp.array3d(dtype=Lanes)):
    """The edges to a node and on from it, metres, the tangent there, and the intrinsic curvature at an angle of 0."""
    before = edge(group, node, lane, positions)
    onward = edge(group, node + 1, lane, positions)
    here = wp.normalize(before + onward)
    return before, onward, here, parallel_transport(axis, here, curvature)


@wp.kernel(enable_backward=False)
def settle_material_frames(nodes: int, state: StateArrays, rods: RodArrays):
    """Turn the material frames of a lane group's rods to where they are at rest, and find the forces on their nodes."""
    group = wp.tid()
    material = rods.material_frames
    for lane in range(LANES):
        rigidity = rods.rigidity[group][lane]
        torsion = rods.torsion[group][lane]
        axis = three(group, lane, rods.axes)
        for node in range(1, nodes - 1):
            length = rods.lengths[group, node - 1][lane]
            next_length = rods.lengths[group, node][lane]
            curvature = three_at(group, node, lane, rods.curvatures)
            before, onward, here, intrinsic = edges_at(group, node, lane, axis, curvature, state.positions)
            discrete = onward / next_length - before / length
            before = wp.normalize(before)
            onward = wp.normalize(onward)
            beside = 1.0 + wp.dot(axis, before) + wp.dot(before, onward) + wp.dot(onward, axis)
            material[group, node, TURNED][lane] = -2.0 * wp.atan2(wp.dot(axis, wp.cross(before, onward)), beside)
            material[group, node, ALONG][lane] = rigidity * wp.dot(discrete, intrinsic)
            material[group, node, ACROSS][lane] = rigidity * wp.dot(discrete, wp.cross(here, intrinsic))
            material[group, node, TWISTING][lane] = 2.0 * torsion / (length + next_length)
        last = nodes - 1
        if rods.far_clamps[group][lane] > 0.0:
            last = nodes - 2
            material[group, nodes - 1, ANGLE][lane] = rods.far_rolls[group][lane]
        for _ in range(ROUNDS):
            step_of_newton(group, lane, nodes, last, material)
        for node in range(nodes):
            for coordinate in range(3):
                rods.forces[group, node, coordinate][lane] = 0.0
        for node in range(1, nodes - 1):
            angle = material[group, node, ANGLE][lane]
            next_angle = material[group, node + 1, ANGLE][lane]
            length = rods.lengths[group, node - 1][lane]
            next_length = rods.lengths[group, node][lane]
            curvature = three_at(group, node, lane, rods.curvatures)
            before, onward, here, intrinsic = edges_at(group, node, lane, axis, curvature, state.positions)
            middle = 0.5 * (angle + next_angle)
            moment = rigidity * (wp.cos(middle) * intrinsic + wp.sin(middle) * wp.cross(here, intrinsic))
            # Twist turns a bent line out of its plane (Bergou et al., ACM Trans. Graphics 29 (2010) 116, sec. 4).
            before = wp.normalize(before)
            onward = wp.normalize(onward)
            twist = material[group, node, TWISTING][lane] * (next_angle - angle + material[group, node, TURNED][lane])
            binormal = twist / (1.0 + wp.dot(before, onward)) * wp.cross(before, onward)
            backward_force = (moment + binormal) / length
            onward_force = (moment - binormal) / next_length
            push(group, node - 1, lane, backward_force, rods.forces)
            push(group, node, lane, -backward_force - onward_force, rods.forces)
            push(group, node + 1, lane, onward_force, rods.forces)
