"""Injected material laws against their equations, on meshes that the test deforms."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.errors import OptionsError
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
    """T = share EA strain has the energy sum share EA L strain^2 / 2."""
    law = ef.anisotropy({"cosine": 0.1, "sine": 0.15}, edges)
    term = ef.edge_tensions(edges, [law], len(body.vertices))
    random = np.random.default_rng(0)
    places = body.vertices + 3e-4 * random.normal(size=body.vertices.shape)
    force = force_of(term, step_state(places))
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(places, force).sum(axis=0), 0.0, atol=1e-12)

    share = law(np.ones(len(edges.lengths)), 1e-3)

    def energy(at):
        lengths = np.linalg.norm(at[edges.ends[:, 1]] - at[edges.ends[:, 0]], axis=1)
        return 0.5 * np.sum(share * edges.stretch_stiffness * edges.lengths * (lengths / edges.lengths - 1.0) ** 2)

    step = random.normal(size=places.shape)
    slope = (energy(places + 1e-7 * step) - energy(places - 1e-7 * step)) / 2e-7
    assert np.sum(force * step) == pytest.approx(-slope, rel=1e-5)


def test_nothing_at_rest(body, edges):
    names = ("coefficient", "change", "cosine", "sine", "ratio", "time", "strength", "strain")
    laws = [
        make(dict.fromkeys(names, 0.5), edges)
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


def directions_of(edges, count=200_000):
    """Directions spread evenly: around the circle of a sheet, over the sphere of a solid (Fibonacci)."""
    turns = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count if edges.dimensions == 3 else np.zeros(count)
    flat = np.sqrt(1.0 - height**2)
    return np.stack([flat * np.cos(turns), flat * np.sin(turns), height], axis=1)


def modulus(edges, make, values, pulled, strain=0.1):
    """Stress over E and strain that edges of all directions add where the material is strained along a direction."""
    directions = directions_of(edges)
    along = (directions @ pulled) ** 2
    everywhere = replace(edges, directions=directions, lengths=np.ones(len(directions)))
    return np.mean(make(values, everywhere)(strain * along, 1e-6) * along) / strain


def towards(angle):
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def test_edges_stiffen_the_material_by_what_the_parameters_say(edges):
    along = towards(0.3)
    assert modulus(edges, ef.strain_stiffening, {"coefficient": 20.0}, along) == pytest.approx(20.0 * 0.1**2, rel=1e-3)
    for change, strain, added in ((0.5, -0.1, 0.5), (0.5, 0.1, 0.0), (-0.2, 0.1, 0.25), (-0.2, -0.1, 0.0)):
        found = modulus(edges, ef.tension_compression_asymmetry, {"change": change}, along, strain)
        assert found == pytest.approx(added, rel=1e-3)


def test_a_change_to_softer_compression_is_relative_to_tension(edges):
    tension, compression = (
        1.0 + modulus(edges, ef.tension_compression_asymmetry, {"change": -0.2}, towards(0.0), strain)
        for strain in (0.1, -0.1)
    )
    assert compression / tension == pytest.approx(0.8, rel=1e-3)


def test_fibres_make_the_modulus_swing_with_the_angle(edges):
    values = {"cosine": 0.1, "sine": 0.2}
    angles = np.linspace(0.0, np.pi, 16, endpoint=False)
    moduli = np.array([1.0 + modulus(edges, ef.anisotropy, values, towards(angle)) for angle in angles])
    mean = moduli.mean()
    assert 2.0 * np.mean(moduli * np.cos(2.0 * angles)) / mean == pytest.approx(0.1, rel=1e-3)
    assert 2.0 * np.mean(moduli * np.sin(2.0 * angles)) / mean == pytest.approx(0.2, rel=1e-3)


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (ef.anisotropy, {"cosine": 0.9, "sine": 0.3}, "must be smaller than 0.89 together, got 0.95"),
        (ef.tension_compression_asymmetry, {"change": -1.0}, "change must be above -1, got -1.0"),
    ],
)
def test_what_no_edge_can_do_is_refused(edges, make, values, message):
    with pytest.raises(OptionsError, match=message):
        make(values, edges)


def test_maxwell_arm_relaxes_with_its_time(edges):
    law = ef.viscoelasticity({"ratio": 3.0 * edges.mean_cosine(4), "time": 0.5}, edges)
    count, duration = len(edges.lengths), 1e-3
    law(np.zeros(count), duration)
    held = np.full(count, 0.02)
    law(held, duration)
    for _ in range(499):
        tension = law(held, duration)
    # A jump of strain, then `time` seconds of holding: the step that jumps relaxes for half of itself.
    np.testing.assert_allclose(tension, 3.0 * 0.02 * np.exp(-(0.499 + 0.0005) / 0.5), rtol=1e-5)


def test_bouc_wen_saturates_and_keeps_a_loop(edges):
    law = ef.hysteresis({"strength": 2.0 * edges.mean_cosine(4), "strain": 0.01}, edges)
    path = np.concatenate([np.linspace(0, 0.1, 500), np.linspace(0.1, 0, 500)])
    tensions = np.array([law(np.full(len(edges.lengths), strain), 1e-3)[0] for strain in path])
    assert tensions[1] == pytest.approx(2.0 * path[1], rel=0.05)
    assert tensions[499] == pytest.approx(2.0 * 0.01, rel=1e-3)
    assert tensions[-1] < -0.9 * 2.0 * 0.01
    assert np.trapz(tensions, path) > 0.0


def test_plastic_edges_follow_beyond_the_yield_strain_only(body, edges):
    rest = edges.lengths.copy()
    term = ef.plasticity({"yield_strain": 0.05, "flow": 100.0}, edges, rest)
    for strain, left in ((0.04, 0.0), (0.1, 0.05), (-0.1, -0.05)):
        rest[:] = edges.lengths
        state = step_state((1.0 + strain) * body.vertices)
        for _ in range(200):
            assert not force_of(term, state).any()
        plastic = (1.0 + strain) * edges.lengths / rest - 1.0
        np.testing.assert_allclose(plastic, strain if left == 0.0 else np.sign(strain) * 0.05, atol=1e-3)
