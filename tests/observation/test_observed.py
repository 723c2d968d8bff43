"""An episode is looked at once, and says how its object is seen."""

from dataclasses import replace

import numpy as np
import pytest

from egophys_core.diagnosis.diagnose import diagnose
from egophys_core.diagnosis.options import DiagnosisOptions
from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.identification import FitOptions, build
from egophys_core.identification.marker_fit import MarkerSearch
from egophys_core.kinds.template import parse_template
from egophys_core.observation import contact, find_hands, observe_episode, observe_episodes
from egophys_core.simulation import ContactKind
from tests.diagnosis.cantilever import TEMPLATE, TRACKS, still_episode
from tests.diagnosis.rehearsed import episodes, sheet
from tests.identification.synthetic import sheet_episode
from tests.kinds.hanging_cable import curve, moved_by_hand, record_of
from tests.kinds.seen_markers import marker_body
from tests.twin.examples import make_twin

SHORT = FitOptions(generations=1, population=4, frame_stride=6, dense_steps=0)


@pytest.fixture
def looks(monkeypatch):
    """The episodes in which someone looked for hands, one entry a look."""
    seen = []
    look = contact.look_at_hand

    def counted(episode, *arguments, **options):
        seen.append(episode.name)
        return look(episode, *arguments, **options)

    monkeypatch.setattr(contact, "look_at_hand", counted)
    return seen


def test_a_build_finds_contacts_once(looks):
    find_hands(sheet_episode())
    once = looks.copy()
    looks.clear()
    build([sheet_episode()], SHORT)
    assert looks == once


def test_what_was_observed_is_not_looked_at_again(looks):
    observed = observe_episodes([sheet_episode()])
    looks.clear()
    twin = build(observed, SHORT)
    assert looks == []
    assert twin.twin_id == build([sheet_episode()], SHORT).twin_id


def test_a_diagnosis_finds_contacts_once(looks, monkeypatch):
    recorded = episodes()[:2]
    for each in recorded:
        find_hands(each)
    once = looks.copy()
    looks.clear()

    class SeenError(Exception):
        """The episodes have their place."""

    def stop(stage, share):
        if stage == "refit the twin as it is":
            raise SeenError

    with pytest.raises(SeenError):
        diagnose(make_twin(sheet()), recorded, DiagnosisOptions(), progress=stop)
    assert looks == once


@pytest.mark.parametrize(("slender", "places"), [(True, 1), (False, 3)], ids=["rod", "lattice"])
def test_what_begins_as_it_is_seen_is_placed_once_for_all_candidates(monkeypatch, slender, places):
    placed = []
    place = "egophys_core.identification.marker_fit.place_model"
    from egophys_core.observation import place_model

    monkeypatch.setattr(place, lambda *each: placed.append(each) or place_model(*each))
    if slender:
        episode = record_of(curve(9), held_first=2, held_last=2)
        body = marker_body(episode, None)
    else:
        episode = still_episode(frames=20)
        body = marker_body(episode, parse_template(TEMPLATE))
    search = MarkerSearch(body, [observe_episode(episode)], 1000.0)
    for numbers in search.unknowns.static_deflection[:3]:
        search.at(numbers)
    assert len(placed) == places


def test_a_surface_says_when_it_is_touched_and_where_it_lay():
    episode = sheet_episode()
    observed = observe_episode(episode)
    assert not observed.is_sparse
    assert observed.episode is observed.record is observed.source is episode
    assert observed.at_rest == pytest.approx(episode.points[: observed.touched].mean(axis=0), abs=1e-6)
    assert (observed.contact[: observed.touched] == ContactKind.NONE).all()
    assert (observed.contact[observed.touched] == ContactKind.HOLD).all()


def test_clamps_hold_markers_all_the_time():
    observed = observe_episode(still_episode())
    assert observed.is_sparse
    assert (observed.contact == ContactKind.HOLD).all()
    assert observed.contact.shape == observed.episode.controllers.shape[:2]
    assert observed.markers is not None
    assert observed.markers.tracks == pytest.approx(TRACKS)


def test_how_hands_move_markers_is_seen_where_rollouts_begin():
    """Held points at 1 m/s to the side, and markers with them."""
    still = still_episode(frames=60)
    shift = (still.times[:, None, None] * [0.0, 1.0, 0.0]).astype(np.float32)
    seen = observe_episode(replace(still, points=still.points + shift, controllers=still.controllers + shift)).markers
    assert seen is not None
    assert seen.velocities == pytest.approx(np.tile([0.0, 1.0, 0.0], (len(seen.velocities), 1)), abs=1e-3)
    assert seen.places[len(seen.held) :] == pytest.approx(TRACKS, abs=1e-4)


def test_markers_and_surfaces_are_not_mixed():
    with pytest.raises(EpisodeError, match=r"cantilever: at most 12 points.*but synthetic: more"):
        observe_episodes([sheet_episode(), still_episode()])


def test_loads_hang_on_markers_of_a_named_episode_and_are_weights():
    with pytest.raises(OptionsError, match="other, which is not among the episodes cantilever"):
        observe_episodes([still_episode()], {"other": 1.0})
    with pytest.raises(OptionsError, match=r"must be newtons, not negative, got -1"):
        observe_episodes([still_episode()], {"cantilever": -1.0})
    with pytest.raises(OptionsError, match=r"loads and templates are for recordings of at most 12.*leave it out"):
        observe_episodes([sheet_episode()], {"synthetic": 1.0})
    (observed,) = observe_episodes([still_episode()], {"cantilever": 0.5})
    assert observed.load == 0.5


def test_options_that_do_not_go_with_what_is_seen_are_refused(tmp_path):
    with pytest.raises(OptionsError, match="templates are for records of a few markers: leave it out"):
        build([sheet_episode()], FitOptions(template=TEMPLATE))
    with pytest.raises(OptionsError, match="leave the checkpoint out"):
        build([still_episode()], checkpoint=tmp_path / "search")
    with pytest.raises(OptionsError, match="template must be box"):
        build([still_episode()], FitOptions(template="box:1x2"))


def test_a_few_points_of_what_no_clamp_holds_are_refused_before_they_are_fitted():
    still = still_episode(frames=20)
    away = np.linspace(0.5, 0.0, still.frames, dtype=np.float32)[:, None, None]
    reaching = replace(still, controllers=still.controllers - away)
    with pytest.raises(
        EpisodeError, match=r"cantilever: its 3 tracked points are 9 cm .* so few make no surface; track"
    ):
        build([reaching])


def test_a_twin_of_markers_says_all_that_it_was_made_with():
    moved = moved_by_hand(record_of(curve(9), held_first=2, held_last=2, frames=40))
    twin = build([moved], FitOptions(density=1200.0), seed=3, parent_id="0123456789abcdef")
    settings = twin.provenance.settings
    assert (settings["template"], settings["density"], settings["loads"]) == ("", 1200.0, {})
    assert (twin.provenance.seed, twin.provenance.parent_id) == (3, "0123456789abcdef")
    assert "generations" not in settings


@pytest.mark.parametrize(("up", "words"), [(-1.0, "1.0. m below"), (-0.05, "0.0. m below"), (0.75, "0.7. m above")])
def test_what_rests_far_from_the_table_is_refused(up, words):
    episode = sheet_episode()
    moved = replace(episode, points=episode.points + [0.0, 0.0, up], controllers=episode.controllers + [0.0, 0.0, up])
    with pytest.raises(EpisodeError, match=f"{words} the table.*--no-table"):
        observe_episode(moved)
    assert observe_episode(replace(moved, no_table=True)).hangs
