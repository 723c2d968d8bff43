"""Springs with another law than Hooke's: the loop over springs, composed with the laws of effects.

With a factor f on its stiffness and a shift s of its rest length, over that length, a spring pulls with
f k min(l - l0 (1 + s), e_max); laws that act together multiply their factors and add their shifts. What a spring
remembers is read from the state before the substep and written to the one after it, which may be the same.
"""

from functools import cache

import warp as wp

from egophys_core.lanes import LANES, Lanes
from egophys_core.lanes.state import ParameterArrays, StateArrays
from egophys_core.simulation.terms.effects import EffectArrays
from egophys_core.simulation.terms.springs import SHORTEST_LENGTH, SpringArrays, elastic_coefficient, pressed

Law = tuple[str, wp.Function, int]
"""Name of the effect, its function, and how many numbers of a spring it remembers."""


@cache
def lawful_springs(laws: tuple[Law, ...], first_column: int, alone: int) -> wp.Function:
    """The loop over springs with law number `alone`, or with whichever of all laws a lane group has if that is -1.

    Args:
        first_column: of the laws in `EffectArrays.columns`.
    """
    law_of_spring = _one_law(laws[alone][1:]) if alone >= 0 else _each_law(laws, first_column)

    @wp.func
    def add_lawful_forces(
        group: int,
        first: int,
        last: int,
        dt: Lanes,
        begun: Lanes,
        state: StateArrays,
        springs: SpringArrays,
        parameters: ParameterArrays,
        effects: EffectArrays,
        remembered: wp.array3d(dtype=Lanes),
        forces: wp.array3d(dtype=Lanes),
    ):
        lost = Lanes(1.0) - parameters.compression_ratio[group]
        positions = state.positions
        velocities = state.velocities
        memory = state.memory
        ends = springs.ends
        stiffness = springs.stiffness
        damping = springs.damping
        rest_lengths = springs.rest_lengths
        longest_extensions = springs.longest_extensions
        # Read before the loop: in it the compiler could not tell that they stay the same.
        column = effects.columns[group, wp.static(first_column + max(alone, 0))]
        slot = effects.slots[wp.static(max(alone, 0))]
        a = Lanes()
        b = Lanes()
        c = Lanes()
        d = Lanes()
        if wp.static(alone >= 0):
            a = effects.numbers[group, column]
            b = effects.numbers[group, column + 1]
            c = effects.numbers[group, column + 2]
            d = effects.numbers[group, column + 3]
        for node in range(first, last):
            x = positions[group, node, 0]
            y = positions[group, node, 1]
            z = positions[group, node, 2]
            vx = velocities[group, node, 0]
            vy = velocities[group, node, 1]
            vz = velocities[group, node, 2]
            fx = Lanes()
            fy = Lanes()
            fz = Lanes()
            for spring in range(springs.starts[node], springs.starts[node + 1]):
                other = ends[spring]
                dx = positions[group, other, 0] - x
                dy = positions[group, other, 1] - y
                dz = positions[group, other, 2] - z
                squared_length = wp.cw_mul(dx, dx) + wp.cw_mul(dy, dy) + wp.cw_mul(dz, dz)
                rest_length = rest_lengths[group, spring]
                strain = strain_of(squared_length, rest_length)
                factor, shift = law_of_spring(
                    group, spring, slot, strain, dt, begun, a, b, c, d, effects, memory, remembered
                )
                shifted = rest_length + wp.cw_mul(rest_length, shift)
                kept = Lanes(1.0) - wp.cw_mul(lost, pressed(squared_length, shifted))
                elastic = elastic_coefficient(
                    squared_length,
                    wp.cw_mul(factor, wp.cw_mul(kept, stiffness[group, spring])),
                    shifted,
                    longest_extensions[group, spring],
                )
                gamma = damping[group, spring]
                gx = wp.cw_mul(elastic, dx) + wp.cw_mul(gamma, velocities[group, other, 0] - vx)
                gy = wp.cw_mul(elastic, dy) + wp.cw_mul(gamma, velocities[group, other, 1] - vy)
                gz = wp.cw_mul(elastic, dz) + wp.cw_mul(gamma, velocities[group, other, 2] - vz)
                fx += gx
                fy += gy
                fz += gz
                forces[group, other, 0] -= gx
                forces[group, other, 1] -= gy
                forces[group, other, 2] -= gz
            forces[group, node, 0] += fx
            forces[group, node, 1] += fy
            forces[group, node, 2] += fz

    return add_lawful_forces


@wp.func
def strain_of(squared_length: Lanes, rest_length: Lanes) -> Lanes:
    """l / l0 - 1."""
    strain = Lanes()
    for lane in range(LANES):
        length = wp.sqrt(wp.max(squared_length[lane], SHORTEST_LENGTH * SHORTEST_LENGTH))
        strain[lane] = length / rest_length[lane] - 1.0
    return strain


def _one_law(law: tuple[wp.Function, int]) -> wp.Function:
    """The factor and shift of one law, whose numbers and slot the caller has read."""
    function, memories = law

    @wp.func
    def law_of_spring(
        group: int,
        spring: int,
        slot: int,
        strain: Lanes,
        dt: Lanes,
        begun: Lanes,
        a: Lanes,
        b: Lanes,
        c: Lanes,
        d: Lanes,
        effects: EffectArrays,
        memory: wp.array3d(dtype=Lanes),
        remembered: wp.array3d(dtype=Lanes),
    ):
        first = Lanes()
        second = Lanes()
        if wp.static(memories > 0):
            first = memory[group, spring, slot]
        if wp.static(memories > 1):
            second = memory[group, spring, slot + 1]
        factor, shift, next_first, next_second = function(strain, first, second, dt, begun, a, b, c, d)
        if wp.static(memories > 0):
            remembered[group, spring, slot] = next_first
        if wp.static(memories > 1):
            remembered[group, spring, slot + 1] = next_second
        return factor, shift

    return law_of_spring


def _each_law(laws: tuple[Law, ...], first_column: int) -> wp.Function:
    """The factors and shifts of all laws that a lane group has, together."""
    if not laws:

        @wp.func
        def no_law(
            group: int,
            spring: int,
            slot: int,
            strain: Lanes,
            dt: Lanes,
            begun: Lanes,
            a: Lanes,
            b: Lanes,
            c: Lanes,
            d: Lanes,
            effects: EffectArrays,
            memory: wp.array3d(dtype=Lanes),
            remembered: wp.array3d(dtype=Lanes),
        ):
            return Lanes(1.0), Lanes()

        return no_law
    index = len(laws) - 1
    laws_before = _each_law(laws[:-1], first_column)
    last_law = _one_law(laws[-1][1:])

    @wp.func
    def laws_of_spring(
        group: int,
        spring: int,
        slot: int,
        strain: Lanes,
        dt: Lanes,
        begun: Lanes,
        a: Lanes,
        b: Lanes,
        c: Lanes,
        d: Lanes,
        effects: EffectArrays,
        memory: wp.array3d(dtype=Lanes),
        remembered: wp.array3d(dtype=Lanes),
    ):
        factor, shift = laws_before(group, spring, slot, strain, dt, begun, a, b, c, d, effects, memory, remembered)
        column = effects.columns[group, wp.static(first_column + index)]
        if column >= 0:
            its_factor, its_shift = last_law(
                group,
                spring,
                effects.slots[wp.static(index)],
                strain,
                dt,
                begun,
                effects.numbers[group, column],
                effects.numbers[group, column + 1],
                effects.numbers[group, column + 2],
                effects.numbers[group, column + 3],
                effects,
                memory,
                remembered,
            )
            factor = wp.cw_mul(factor, its_factor)
            shift = shift + its_shift
        return factor, shift

    return laws_of_spring
