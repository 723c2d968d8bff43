"""Added mass against its equation of motion: inertia along the normal of a sheet, and no weight."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.effects import TwinEffect
from egophys_core.simulation import batch_of_models, rollout
from tests.simulation.scenes import FAR_BELOW, frame_times, idle_controls, sheet_model

GRAVITY = 9.81


def turned(positions: np.ndarray, about: str) -> np.ndarray:
    """A level sheet lying as it is, or standing on its edge."""
    x, y, z = positions.T
    return np.stack([x, y, z] if about == "level" else [x, z, y], axis=1).astype(np.float32)


def falls(ratio: float, about: str, seconds: float = 0.3) -> np.ndarray:
    """[3] metres that a sheet of so much added mass goes from rest."""
    model = sheet_model(drag=0.0)
    model = replace(
        model,
        parameters=replace(model.parameters, gravity=GRAVITY),
        effects=(TwinEffect(name="added_mass", values={"ratio": ratio}),),
    )
    start = turned(model.graph.positions, about)
    batch = batch_of_models(
        [model], [idle_controls(frame_times(seconds, 1 / 600))], starts=[start], ground_height=FAR_BELOW
    )
    result = rollout(batch)
    result.raise_on_failure()
    return (result.positions[0, -1] - start).mean(axis=0)


@pytest.mark.parametrize("ratio", [0.0, 0.5, 2.0])
def test_sheet_falls_slower_flat_than_on_its_edge(ratio):
    free = -0.5 * GRAVITY * 0.3**2
    assert falls(ratio, "level")[2] == pytest.approx(free / (1 + ratio), rel=0.02)
    assert falls(ratio, "edge")[2] == pytest.approx(free, rel=0.02)


def test_sheet_aslant_slides_to_the_side_as_the_equation_has_it():
    model = sheet_model(drag=0.0)
    ratio, slope = 1.0, 0.6
    parameters = replace(model.parameters, gravity=GRAVITY, added_mass=ratio)
    start = model.graph.positions.astype(np.float64)
    start = start @ np.array([[np.cos(slope), 0, -np.sin(slope)], [0, 1, 0], [np.sin(slope), 0, np.cos(slope)]]).T
    batch = batch_of_models(
        [replace(model, parameters=parameters)],
        [idle_controls(frame_times(0.2, 1 / 600))],
        starts=[start.astype(np.float32)],
        ground_height=FAR_BELOW,
    )
    moved = (rollout(batch).positions[0, -1] - start).mean(axis=0)
    normal = np.linalg.svd(start - start.mean(axis=0))[2][2]
    weight = np.array([0.0, 0.0, -GRAVITY])
    expected = 0.5 * 0.2**2 * (weight - ratio / (1 + ratio) * (weight @ normal) * normal)
    assert moved == pytest.approx(expected, abs=2e-3)


def test_sheet_without_added_mass_is_simulated_to_the_bit_as_beside_one_that_has_it():
    model = sheet_model(drag=0.0)
    plain = replace(model, parameters=replace(model.parameters, gravity=GRAVITY))
    airy = replace(plain, parameters=replace(plain.parameters, added_mass=1.0))
    controls = idle_controls(frame_times(0.1, 1 / 600))
    alone = rollout(batch_of_models([plain], [controls], ground_height=FAR_BELOW)).positions[0]
    beside = rollout(batch_of_models([plain, airy], [controls] * 2, ground_height=FAR_BELOW)).positions
    assert np.array_equal(alone, beside[0])
    assert not np.array_equal(beside[0], beside[1])
