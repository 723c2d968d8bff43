"""Planted material laws against their equations, on meshes that the test deforms."""

import numpy as np
import pytest

from egophys_core.rehearsal import RehearsalObject, RehearsalOptions
from egophys_core.rehearsal import edge_forces as ef
from egophys_core.rehearsal.bodies import make_body
from tests.rehearsal.steps import force_of, step_state

KINDS = (RehearsalObject.SHEET, RehearsalObject.ELLIPSOID)


@pytest.fixture(scope="module", params=KINDS)
def body(request):
    return make_body(RehearsalOptions(object=request.param, points=3), 0)


@pytest.fixture(scope="module")
def edges(body):
    first, second = np.triu_indices(body.elements.shape[1], 1)
    pairs = np.stack([body.elements[:, first], body.elements[:, second]], axis=-1).reshape(-1, 2)
    return ef.make_edges(body, np.unique(np.sort(pairs, axis=1), axis=0))


def test_edges_share_the_volume(body, edges):
    corners = body.vertices[body.elements]
    sides = corners[:, 1:] - corners[:, :1]
    if body.is_sheet:
        volume = body.thickness * 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()
    else:
        volume = np.abs(np.linalg.det(sides)).sum() / 6.0
    assert (edges.stretch_stiffness * edges.lengths).sum() == pytest.approx(body.young * volume)


def test_forces_are_internal_and_the_slope_of_the_energy(body, edges):
    """T = ratio EA strain has the energy sum ratio EA L strain^2 / 2."""
    term = ef.edge_tensions(edges, [ef.anisotropy({"ratio": 2.0, "angle": 0.5}, edges)], len(body.vertices))
    random = np.random.default_rng(0)
    places = body.vertices + 3e-4 * random.normal(size=body.vertices.shape)
    force = force_of(term, step_state(places))
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(places, force).sum(axis=0), 0.0, atol=1e-12)

    share = 2.0 * (edges.directions @ [np.cos(0.5), np.sin(0.5), 0.0]) ** 4

    def energy(at):
        lengths = np.linalg.norm(at[edges.ends[:, 1]] - at[edges.ends[:, 0]], axis=1)
        return 0.5 * np.sum(share * edges.stretch_stiffness * edges.lengths * (lengths / edges.lengths - 1.0) ** 2)

    way = random.normal(size=places.shape)
    slope = (energy(places + 1e-7 * way) - energy(places - 1e-7 * way)) / 2e-7
    assert np.sum(force * way) == pytest.approx(-slope, rel=1e-5)


def test_nothing_at_rest(body, edges):
    laws = [
        make(dict.fromkeys(("beta", "ratio", "angle", "tau", "w"), 1.0), edges)
        for make in (
            ef.strain_stiffening,
            ef.tension_compression_asymmetry,
            ef.anisotropy,
            ef.viscoelasticity,
            ef.hysteresis,
        )
    ]
    term = ef.edge_tensions(edges, laws, len(body.vertices))
    np.testing.assert_allclose(force_of(term, step_state(body.vertices)), 0.0, atol=1e-12)


def test_stiffening_is_cubic_and_asymmetry_is_in_tension(edges):
    strains = np.array([-0.1, 0.0, 0.2])
    np.testing.assert_allclose(ef.strain_stiffening({"beta": 10.0}, edges)(strains, 1e-3), [-0.01, 0.0, 0.08])
    np.testing.assert_allclose(ef.tension_compression_asymmetry({"ratio": 2.0}, edges)(strains, 1e-3), [0.0, 0.0, 0.4])


def test_maxwell_arm_relaxes_with_its_time(edges):
    law = ef.viscoelasticity({"ratio": 3.0, "tau": 0.5}, edges)
    count, duration = len(edges.lengths), 1e-3
    law(np.zeros(count), duration)
    held = np.full(count, 0.02)
    law(held, duration)
    for _ in range(499):
        tension = law(held, duration)
    # A jump of strain, then tau seconds of holding: the step that jumps relaxes for half of itself.
    np.testing.assert_allclose(tension, 3.0 * 0.02 * np.exp(-(0.499 + 0.0005) / 0.5), rtol=1e-5)


def test_bouc_wen_saturates_and_keeps_a_loop(edges):
    law = ef.hysteresis({"ratio": 2.0, "w": 0.01}, edges)
    path = np.concatenate([np.linspace(0, 0.1, 500), np.linspace(0.1, 0, 500)])
    tensions = np.array([law(np.full(len(edges.lengths), strain), 1e-3)[0] for strain in path])
    assert tensions[1] == pytest.approx(2.0 * path[1], rel=0.05)
    assert tensions[499] == pytest.approx(2.0 * 0.01, rel=1e-3)
    assert tensions[-1] < -0.9 * 2.0 * 0.01
    assert np.trapz(tensions, path) > 0.0


def test_plastic_edges_follow_beyond_the_yield_strain_only(body, edges):
    rest = edges.lengths.copy()
    term = ef.plasticity({"yield_strain": 0.05, "tau": 0.01}, edges, rest)
    for strain, left in ((0.04, 0.0), (0.1, 0.05), (-0.1, -0.05)):
        rest[:] = edges.lengths
        state = step_state((1.0 + strain) * body.vertices)
        for _ in range(200):
            assert not force_of(term, state).any()
        plastic = (1.0 + strain) * edges.lengths / rest - 1.0
        np.testing.assert_allclose(plastic, strain if left == 0.0 else np.sign(strain) * 0.05, atol=1e-3)
