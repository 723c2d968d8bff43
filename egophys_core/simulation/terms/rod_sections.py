"""How the sections of a rod are turned about its line, and how that bends the line.

What was kept on a coil is bent by nature, to one of its own sides. Where that side points is told by its clamps, and by
twist, which bends a line that is bent already, too. Twist is settled long before a line has moved (Bergou et al., ACM
Trans. Graphics 27 (2008) 63): at the start of each frame the sections are turned to where they are at rest.

Piece j is turned by an angle theta_j from where the least rotation from the rod's axis to its direction has it. From
piece to piece that rotation turns about the line, too, at node i by m_i: minus the solid angle between the axis and
both pieces (van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125). What is least is the sum over nodes of

    GJ (theta_i+1 - theta_i + m_i)^2 / 2H - EI t . k((theta_i + theta_i+1) / 2)

with pieces named by the node after them, t and H as in `rod_bending`, and k the natural bend, 1/m, of a section at that
angle. What a clamp holds is not turned: two points on a line do not tell that it rolls.
"""

import warp as wp

from egophys_core.simulation.lanes import LANES, Lanes
from egophys_core.simulation.state import StateArrays

TORSION, FAR, BEND, AXIS, FIRST_LENGTH = 2, 3, 4, 7, 10
"""Columns: GJ, N m^2; 1 if a clamp holds the far end, else 0; of three coordinates each the natural bend on the
straight rod, 1/m, and the axis; the first piece's length, metres. Before them stand EI and what `rod_bending` reads."""

ANGLE, TURNED, ALONG, ACROSS, TWISTING, PIVOT, BESIDE, STEP = 3, 4, 5, 6, 7, 8, 9, 10
"""After the lengths there are by node the force on it, N, three coordinates, and then: theta; m; EI t . k at angles of
0 and of 90 degrees; GJ / H; and of Newton's method a row of the elimination and the step."""

PER_NODE = 11

ROUNDS = 4
"""Of Newton's method in a frame, from the angles of the last one."""

LEAST_SUM = 0.1
"""Of 1 and the cosine between the axis and the line: no least rotation turns a direction into its opposite."""


@wp.func
def three(group: int, column: int, lane: int, numbers: wp.array2d(dtype=Lanes)) -> wp.vec3:
    """Three numbers of a lane."""
    return wp.vec3(numbers[group, column][lane], numbers[group, column + 1][lane], numbers[group, column + 2][lane])


@wp.func
def way(group: int, node: int, lane: int, positions: wp.array3d(dtype=Lanes)) -> wp.vec3:
    """Metres, from the node before to a node."""
    return wp.vec3(
        positions[group, node, 0][lane] - positions[group, node - 1, 0][lane],
        positions[group, node, 1][lane] - positions[group, node - 1, 1][lane],
        positions[group, node, 2][lane] - positions[group, node - 1, 2][lane],
    )


@wp.func
def brought_along(axis: wp.vec3, direction: wp.vec3, across: wp.vec3) -> wp.vec3:
    """Where the least rotation of the axis into a direction brings what is across the axis (Rodrigues' formula)."""
    return across - wp.dot(across, direction) / wp.max(1.0 + wp.dot(axis, direction), LEAST_SUM) * (axis + direction)


@wp.func
def moment_about(group: int, row: int, lane: int, angle: float, numbers: wp.array2d(dtype=Lanes)) -> float:
    """N m, by which the natural bend resists a growing angle at a node."""
    along = numbers[group, row + ALONG][lane]
    return along * wp.sin(angle) - numbers[group, row + ACROSS][lane] * wp.cos(angle)


@wp.func
def stiffness_about(group: int, row: int, lane: int, angle: float, numbers: wp.array2d(dtype=Lanes)) -> float:
    """N m, a quarter of the slope of that moment, so far as it is one of a minimum."""
    along = numbers[group, row + ALONG][lane]
    return 0.25 * wp.max(along * wp.cos(angle) + numbers[group, row + ACROSS][lane] * wp.sin(angle), 0.0)


@wp.func
def step_of_newton(group: int, lane: int, nodes: int, last: int, rows: int, numbers: wp.array2d(dtype=Lanes)):
    """Bring the angles of pieces 2..last nearer to rest (elimination along the rod, then back)."""
    for piece in range(2, last + 1):
        before = rows + (piece - 1) * PER_NODE
        row = before + PER_NODE
        here = numbers[group, row + ANGLE][lane]
        backward = numbers[group, before + ANGLE][lane]
        twisting = numbers[group, before + TWISTING][lane]
        bending = stiffness_about(group, before, lane, 0.5 * (backward + here), numbers)
        right = -twisting * (here - backward + numbers[group, before + TURNED][lane])
        right -= 0.5 * moment_about(group, before, lane, 0.5 * (backward + here), numbers)
        pivot = twisting + bending
        beside = bending - twisting
        if piece < nodes - 1:
            onward = numbers[group, row + PER_NODE + ANGLE][lane]
            twisting = numbers[group, row + TWISTING][lane]
            right += twisting * (onward - here + numbers[group, row + TURNED][lane])
            right -= 0.5 * moment_about(group, row, lane, 0.5 * (here + onward), numbers)
            pivot += twisting + stiffness_about(group, row, lane, 0.5 * (here + onward), numbers)
        if piece > 2:
            share = beside / numbers[group, before + PIVOT][lane]
            pivot -= share * beside
            right -= share * numbers[group, before + STEP][lane]
        numbers[group, row + PIVOT][lane] = pivot
        numbers[group, row + BESIDE][lane] = beside
        numbers[group, row + STEP][lane] = right
    for back in range(last - 1):
        row = rows + (last - back) * PER_NODE
        right = numbers[group, row + STEP][lane]
        if back > 0:
            right -= numbers[group, row + PER_NODE + BESIDE][lane] * numbers[group, row + PER_NODE + STEP][lane]
        numbers[group, row + STEP][lane] = right / numbers[group, row + PIVOT][lane]
    for piece in range(2, last + 1):
        row = rows + piece * PER_NODE
        numbers[group, row + ANGLE][lane] += numbers[group, row + STEP][lane]


@wp.func
def push(group: int, row: int, lane: int, force: wp.vec3, numbers: wp.array2d(dtype=Lanes)):
    """Add to the force on a node."""
    for axis in range(3):
        numbers[group, row + axis][lane] += force[axis]


@wp.func
def bent_at(group: int, node: int, lane: int, axis: wp.vec3, bend: wp.vec3, positions: wp.array3d(dtype=Lanes)):
    """The ways to a node and on from it, metres, the line's direction there, and the natural bend at an angle of 0."""
    before = way(group, node, lane, positions)
    onward = way(group, node + 1, lane, positions)
    here = wp.normalize(before + onward)
    return before, onward, here, brought_along(axis, here, bend)


@wp.kernel(enable_backward=False)
def settle_sections(column: int, nodes: int, state: StateArrays, numbers: wp.array2d(dtype=Lanes)):
    """Turn the sections of the rods of a lane group to where they are at rest, and find the forces on their nodes."""
    group = wp.tid()
    lengths = column + FIRST_LENGTH
    rows = lengths + nodes - 1
    for lane in range(LANES):
        rigidity = numbers[group, column][lane]
        torsion = numbers[group, column + TORSION][lane]
        axis = three(group, column + AXIS, lane, numbers)
        bend = three(group, column + BEND, lane, numbers)
        for node in range(1, nodes - 1):
            row = rows + node * PER_NODE
            length = numbers[group, lengths + node - 1][lane]
            next_length = numbers[group, lengths + node][lane]
            before, onward, here, natural = bent_at(group, node, lane, axis, bend, state.positions)
            turn = onward / next_length - before / length
            before = wp.normalize(before)
            onward = wp.normalize(onward)
            beside = 1.0 + wp.dot(axis, before) + wp.dot(before, onward) + wp.dot(onward, axis)
            numbers[group, row + TURNED][lane] = -2.0 * wp.atan2(wp.dot(axis, wp.cross(before, onward)), beside)
            numbers[group, row + ALONG][lane] = rigidity * wp.dot(turn, natural)
            numbers[group, row + ACROSS][lane] = rigidity * wp.dot(turn, wp.cross(here, natural))
            numbers[group, row + TWISTING][lane] = 2.0 * torsion / (length + next_length)
        last = nodes - 1 - int(numbers[group, column + FAR][lane])
        for _ in range(ROUNDS):
            step_of_newton(group, lane, nodes, last, rows, numbers)
        for node in range(nodes):
            for coordinate in range(3):
                numbers[group, rows + node * PER_NODE + coordinate][lane] = 0.0
        for node in range(1, nodes - 1):
            row = rows + node * PER_NODE
            angle = numbers[group, row + ANGLE][lane]
            next_angle = numbers[group, row + PER_NODE + ANGLE][lane]
            length = numbers[group, lengths + node - 1][lane]
            next_length = numbers[group, lengths + node][lane]
            before, onward, here, natural = bent_at(group, node, lane, axis, bend, state.positions)
            middle = 0.5 * (angle + next_angle)
            moment = rigidity * (wp.cos(middle) * natural + wp.sin(middle) * wp.cross(here, natural))
            # Twist turns a bent line out of its plane (Bergou et al., ACM Trans. Graphics 29 (2010) 116, sec. 4).
            before = wp.normalize(before)
            onward = wp.normalize(onward)
            twist = numbers[group, row + TWISTING][lane] * (next_angle - angle + numbers[group, row + TURNED][lane])
            binormal = twist / (1.0 + wp.dot(before, onward)) * wp.cross(before, onward)
            backward_force = (moment + binormal) / length
            onward_force = (moment - binormal) / next_length
            push(group, row - PER_NODE, lane, backward_force, numbers)
            push(group, row, lane, -backward_force - onward_force, numbers)
            push(group, row + PER_NODE, lane, onward_force, numbers)
