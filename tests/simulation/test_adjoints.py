"""The adjoints that are written out: against those that Warp generates, and against differences of the reference."""

import types

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from egophys_core.lanes import LANES, Lanes, pack, unpack
from egophys_core.lanes.state import ParameterArrays, StateArrays
from egophys_core.simulation.device_arrays import PARAMETER_NAMES
from egophys_core.simulation.terms import spring_adjoint as spring_adjoint
from egophys_core.simulation.terms.ground import collide, project_upward_force
from egophys_core.simulation.terms.springs import UNLIMITED, SpringArrays, add_grip_forces, add_spring_forces
from tests.reference.simulator import contact
from tests.simulation.scenes import parameters


def without_adjoint(function: wp.Function) -> wp.Function:
    """The same function for which Warp generates the adjoint itself."""
    original = function.func
    name = f"plain_{original.__name__}"
    copy = types.FunctionType(original.__code__, original.__globals__, name)
    copy.__annotations__, copy.__module__, copy.__qualname__ = original.__annotations__, __name__, name
    return wp.func(copy)


plain_springs = without_adjoint(add_spring_forces)
plain_grips = without_adjoint(add_grip_forces)
plain_collide = without_adjoint(collide)
plain_projection = without_adjoint(project_upward_force)


@wp.kernel
def spring_kernel(
    plain: bool,
    nodes: int,
    state: StateArrays,
    springs: SpringArrays,
    parameters: ParameterArrays,
    grips: bool,
    forces: wp.array3d(dtype=Lanes),
):
    group = wp.tid()
    if grips:
        if plain:
            plain_grips(group, 0, nodes, state, springs, forces)
        else:
            add_grip_forces(group, 0, nodes, state, springs, forces)
    else:
        if plain:
            plain_springs(group, 0, nodes, state, springs, parameters, forces)
        else:
            add_spring_forces(group, 0, nodes, state, springs, parameters, forces)


@wp.kernel
def table_kernel(plain: bool, inputs: wp.array(dtype=Lanes), outputs: wp.array(dtype=Lanes)):
    # Inputs: height, velocity, dt, restitution, friction; then height, force, projection, threshold.
    if plain:
        vx, vy, vz, rise = plain_collide(inputs[0], inputs[1], inputs[2], inputs[3], inputs[4], inputs[5], inputs[6])
        outputs[0] = vx
        outputs[1] = vy
        outputs[2] = vz
        outputs[3] = rise
        outputs[4] = plain_projection(inputs[7], inputs[8], inputs[9], inputs[10])
    else:
        vx, vy, vz, rise = collide(inputs[0], inputs[1], inputs[2], inputs[3], inputs[4], inputs[5], inputs[6])
        outputs[0] = vx
        outputs[1] = vy
        outputs[2] = vz
        outputs[3] = rise
        outputs[4] = project_upward_force(inputs[7], inputs[8], inputs[9], inputs[10])


def spring_derivatives(*, plain: bool, grips: bool) -> dict[str, np.ndarray]:
    """Of a random weighted sum of the forces in 16 rollouts, by everything the springs read."""
    generator = np.random.default_rng(0)
    nodes, points, springs = 7, 10, 20
    first = np.sort(generator.integers(0, nodes, springs))
    # Without grips ends are nodes, with grips they are controller points.
    ends = generator.integers(nodes, points, springs) if grips else (first + generator.integers(1, 4, springs)) % nodes

    def lanes(values: np.ndarray) -> wp.array:
        return wp.array(pack(values), dtype=Lanes, device="cpu", requires_grad=True)

    shape = (2 * LANES, springs)
    arrays = SpringArrays()
    arrays.starts = wp.array(np.searchsorted(first, np.arange(nodes + 1)), dtype=int, device="cpu")
    arrays.ends = wp.array(ends, dtype=int, device="cpu")
    arrays.stiffness = lanes(generator.uniform(0, 2, shape))
    arrays.damping = lanes(generator.uniform(0, 1, shape))
    arrays.rest_lengths = lanes(generator.uniform(0.5, 2, shape))
    longest = np.where(generator.random(shape) < 0.5, 0.0 if grips else 0.2, UNLIMITED)
    arrays.longest_extensions = lanes(longest)
    numbers = ParameterArrays()
    for name in (*PARAMETER_NAMES, "contact_height"):
        setattr(numbers, name, lanes(generator.uniform(0, 1, 2 * LANES)))
    numbers.across = wp.zeros((0, 4), dtype=int, device="cpu", requires_grad=True)
    numbers.masses, numbers.inverse_masses = (lanes(np.ones((2 * LANES, nodes))) for _ in range(2))
    state = StateArrays()
    state.positions, state.velocities = (lanes(generator.normal(0, 1, (2 * LANES, points, 3))) for _ in range(2))
    state.memory = lanes(np.zeros((2 * LANES, springs, 1)))
    forces = lanes(np.zeros((2 * LANES, nodes, 3)))
    with wp.Tape() as tape:
        wp.launch(
            spring_kernel, dim=2, inputs=[plain, nodes, state, arrays, numbers, grips], outputs=[forces], device="cpu"
        )
    weights = pack(generator.normal(0, 1, (2 * LANES, nodes, 3)))
    tape.backward(grads={forces: wp.array(weights, dtype=Lanes, device="cpu")})
    read = {
        **{name: getattr(arrays, name) for name in ("stiffness", "damping", "rest_lengths", "longest_extensions")},
        **({} if grips else {"compression_ratio": numbers.compression_ratio}),
        "positions": state.positions,
        "velocities": state.velocities,
    }
    return {name: unpack(array.grad.numpy(), 2 * LANES) for name, array in read.items()}


@pytest.mark.parametrize("grips", [False, True])
def test_adjoint_of_springs_is_the_one_that_warp_generates(grips):
    assert add_spring_forces.custom_grad_func is not None
    assert plain_springs.custom_grad_func is None
    written, generated = (spring_derivatives(plain=plain, grips=grips) for plain in (False, True))
    for name, expected in generated.items():
        if grips and name == "longest_extensions":
            # 0 or unlimited: what a contact is, not a number that is fitted.
            continue
        assert np.abs(expected).max() > 0.1, name
        assert np.abs(written[name] - expected).max() < 1e-5 * max(1.0, np.abs(expected).max()), name


def table_derivatives(inputs: np.ndarray, weights: np.ndarray, *, plain: bool) -> np.ndarray:
    """[8, 11] derivatives of the weighted sum of outputs, for inputs [8, 11] and weights [8, 5] of each lane."""
    read = wp.array(np.ascontiguousarray(inputs.T, np.float32), dtype=Lanes, device="cpu", requires_grad=True)
    out = wp.zeros(5, dtype=Lanes, device="cpu", requires_grad=True)
    with wp.Tape() as tape:
        wp.launch(table_kernel, dim=1, inputs=[plain, read], outputs=[out], device="cpu")
    grads = wp.array(np.ascontiguousarray(weights.T, np.float32), dtype=Lanes, device="cpu")
    tape.backward(grads={out: grads})
    return read.grad.numpy().T


# Height, velocity, dt, restitution, friction; height in the band, force, projection, threshold.
LOWEST = np.array([-0.2, -1, -1, -2, 0.25, 0, 0, -0.01, -1, 0, 0.001])
HIGHEST = np.array([1, 1, 1, 1, 0.5, 1, 1, 0.02, 1, 1, 0.02])
DT = 4
"""Column of the time of a substep, which is no input that is fitted."""


def random_inputs(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs [8, 11] of each lane, as float32 holds them, and weights [8, 5] of its outputs."""
    generator = np.random.default_rng(seed)
    inputs = generator.uniform(LOWEST, HIGHEST, (LANES, len(LOWEST))).astype(np.float32)
    return inputs.astype(np.float64), generator.normal(0, 1, (LANES, 5))


def table_loss(inputs: np.ndarray, weights: np.ndarray) -> float:
    """The weighted sum for one lane, from the reference."""
    height, vx, vy, vz, dt, restitution, friction, band_height, force, projection, threshold = inputs
    alpha = parameters(restitution=restitution, friction=friction)
    velocity, rise = contact(height, np.array([vx, vy, vz]), dt, alpha)
    inside = 0 <= band_height < threshold
    left = force - inside * projection * max(force, 0.0)
    return float(weights[:3] @ velocity + weights[3] * rise + weights[4] * left)


def edges(inputs: np.ndarray) -> np.ndarray:
    """Distances of one lane's inputs to where the derivatives jump."""
    height, vx, vy, vz, dt, restitution, friction, band_height, force, _, threshold = inputs
    sliding = np.hypot(vx, vy)
    return np.array(
        [
            height,
            height + dt * vz,
            vz,
            sliding,
            sliding - friction * (1 + restitution) * abs(vz),
            *(restitution, 1 - restitution, friction, 1 - friction),
            *(band_height, band_height - threshold, force),
        ]
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_adjoint_of_the_table_agrees_with_central_differences_in_every_lane(seed):
    inputs, weights = random_inputs(seed)
    written = table_derivatives(inputs, weights, plain=False)
    step = 1e-6
    for lane in range(LANES):
        if np.abs(edges(inputs[lane])).min() < 1e-3:
            continue
        assert written[lane, DT] == 0.0
        for column in np.delete(np.arange(len(LOWEST)), DT):
            ends = [inputs[lane] + by * np.eye(len(LOWEST))[column] for by in (step, -step)]
            up, down = (table_loss(end, weights[lane]) for end in ends)
            assert written[lane, column] == pytest.approx((up - down) / (2 * step), rel=1e-3, abs=1e-3)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_adjoint_of_the_table_is_the_one_that_warp_generates(seed):
    inputs, weights = random_inputs(seed)
    written, generated = (table_derivatives(inputs, weights, plain=plain) for plain in (False, True))
    fitted = np.arange(len(LOWEST)) != DT
    calm = np.array([np.abs(edges(row)).min() >= 1e-3 for row in inputs])
    difference = np.abs(written - generated)[calm][:, fitted]
    assert difference.max(initial=0.0) < 1e-4 * max(1.0, np.abs(generated).max())
