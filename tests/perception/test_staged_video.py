"""Learned stages by option: a drawn video through stages that know it, and what is said where they are missing."""

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial import cKDTree

from egophys_core.cli.main import main
from egophys_core.episode_source import EpisodeSource, Source, load_episodes
from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.perception.learned.weights import LearnedModelError
from egophys_core.perception.live import require_live
from egophys_core.perception.options import Completion, PerceptionOptions
from egophys_core.perception.perceive import perceive
from egophys_core.perception.staged import StageSet
from egophys_core.perception.stages import PointMap, Tracks
from egophys_core.perception.surface.surface_render import project
from egophys_core.recording import read_episode
from tests.perception.learned.tiny_models import save_grounding_dino, save_sam2
from tests.perception.surface.surface_scene import OPTIONS, SIDE, bag, video

HANDLED = 18
"""First frame in which the hand is at the object."""


class Exact:
    """All stages, of a drawn video: each view is looked up by its stamp."""

    def __init__(self, kind: str) -> None:
        self.frames = {frame.stamp_ns: frame for frame in video(kind)[HANDLED:]}
        self.times_segmented = 0

    def masks(self, views):
        self.times_segmented += 1
        for view in views:
            yield self.frames[view.stamp_ns].masks

    def tracks(self, views, queries):
        """What shows the object moves with the nearest material point, what shows the hand with its mask."""
        views = list(views)
        first = self.frames[views[0].stamp_ns]
        places = project(first.points, views[0].camera_matrix, views[0].world_from_camera)[:, :2]
        material = cKDTree(places).query(queries)[1]
        on_hand = first.masks.hand[tuple(queries.astype(int).T[::-1])]
        pixels = np.empty((len(views), len(queries), 2), np.float32)
        for index, view in enumerate(views):
            now = project(self.frames[view.stamp_ns].points, view.camera_matrix, view.world_from_camera)[:, :2]
            hand = np.argwhere(self.frames[view.stamp_ns].masks.hand)[:, ::-1].astype(float)
            carried = queries + hand.mean(axis=0) - queries[on_hand].mean(axis=0)
            carried = hand[cKDTree(hand).query(carried)[1]]
            pixels[index] = np.where(on_hand[:, None], carried, queries + now[material] - places[material])
        return Tracks(pixels=pixels, visible=np.ones(pixels.shape[:2], bool))

    def point_maps(self, views):
        """Of each pixel the nearest material point; of the hand, too, which is near enough to that."""
        for view in views:
            frame = self.frames[view.stamp_ns]
            pixels = project(frame.points, view.camera_matrix, view.world_from_camera)[:, :2]
            rows, columns = np.mgrid[:SIDE, :SIDE]
            nearest = cKDTree(pixels).query(np.column_stack([columns.ravel(), rows.ravel()]))[1]
            points = frame.points[nearest].reshape(SIDE, SIDE, 3).astype(np.float32)
            yield PointMap(points=points, confidence=np.ones((SIDE, SIDE), np.float32))

    def surface(self, image, mask):
        """The material points and what lies below them, half as large and elsewhere."""
        assert mask.any()
        top = next(iter(self.frames.values())).points
        return (np.concatenate([top, top * [1, 1, 0.0]]) + [1, 2, 3]) / 2


@pytest.fixture
def exact(monkeypatch, request):
    """The stages that loading gives, in place of learned ones."""
    stages = Exact(getattr(request, "param", "sheet"))

    def load(options):
        generates = options.completion == Completion.GENERATED
        return StageSet(segmenter=stages, tracker=stages, point_mapper=stages, completer=stages if generates else None)

    monkeypatch.setattr("egophys_core.perception.learned.loading.load_stages", load)
    return stages


def learned(**changes) -> PerceptionOptions:
    return replace(OPTIONS, stages="learned", weights="models", **changes)


def test_points_are_where_the_stages_see_them(exact, tmp_path):
    seen = []
    path = bag(tmp_path / "bag", video("sheet")[HANDLED:])
    perceived = perceive(path, options=learned(), on_observation=seen.append)
    episode, report = perceived.episode, perceived.report
    assert len(seen) == episode.frames == len(exact.frames)
    assert perceived.start_ns == seen[0].view.stamp_ns
    assert (report.posed, report.kind, report.grip_frame) == (episode.frames, "sheet", 0)
    for frame in (0, 13, 26):
        truth = exact.frames[seen[frame].view.stamp_ns]
        known = episode.points[frame][np.isfinite(episode.points[frame]).all(axis=1)]
        assert len(known) > 0.5 * episode.points.shape[1]
        assert cKDTree(truth.points).query(known)[0].mean() < 0.002
        assert seen[frame].masks.object.sum() == truth.masks.object.sum()
    moved = np.linalg.norm(episode.points[-1] - episode.points[0], axis=1)
    assert np.nanmax(moved) > 0.05


def test_masks_are_found_once(exact, tmp_path):
    perceive(bag(tmp_path / "bag", video("sheet")[HANDLED:]), options=learned())
    assert exact.times_segmented == 2, "the first view alone, then all of them"


@pytest.mark.parametrize("exact", ["dome"], indirect=True)
def test_a_generated_shape_fills_in_what_is_hidden(exact, tmp_path):
    path = bag(tmp_path / "bag", video("dome")[HANDLED:])
    seen = perceive(path, options=learned(completion="none")).episode
    whole = perceive(path, options=learned(completion="generated")).episode
    hidden = whole.points[:, seen.points.shape[1] :]
    assert hidden.shape[1] > 10
    shape = cKDTree(exact.surface(None, np.ones(1)) * 2 - [1, 2, 3])
    assert shape.query(hidden[0])[0].max() < 0.01
    first = seen.points[0][np.isfinite(seen.points[0]).all(axis=1)]
    apart = cKDTree(first).query(first, k=2)[0][:, 1]
    assert cKDTree(first).query(hidden[0])[0].min() > np.median(apart)
    assert np.isnan(hidden[1:]).all()
    np.testing.assert_array_equal(whole.points[:, : seen.points.shape[1]], seen.points)


def test_command_takes_them_by_a_flag(exact, tmp_path, capsys):
    path = bag(tmp_path / "bag", video("sheet")[HANDLED:])
    options = ["--side", str(SIDE), "--object-points", "100", "--stages", "learned", "--weights", "models"]
    assert main(["perceive", str(path), "--out", str(tmp_path / "out"), *options]) == 0
    assert "learned stages" in capsys.readouterr().out
    assert read_episode(tmp_path / "out/episode").points.shape[1] == 100
    assert (tmp_path / "out/contact_sheet.png").stat().st_size > 1000


def test_options_that_cannot_be():
    with pytest.raises(OptionsError, match=r"stages learned needs weights.*docs/learned_models.md"):
        PerceptionOptions(stages="learned")
    with pytest.raises(OptionsError, match="completion generated is a learned stage"):
        PerceptionOptions(completion="generated")


def test_live_cameras_have_no_learned_stages():
    require_live(PerceptionOptions())
    with pytest.raises(OptionsError, match="go through a video several times"):
        require_live(learned())


def test_missing_weights_are_named_in_one_error_before_the_work(tmp_path, capsys):
    path = bag(tmp_path / "bag", video("sheet")[:2])
    (tmp_path / "models/sam2").mkdir(parents=True)

    def refused(weights: Path, *more: str) -> str:
        arguments = ["perceive", str(path), "--out", str(tmp_path / "out"), "--stages", "learned", *more]
        assert main([*arguments, "--weights", str(weights)]) == 2
        said = capsys.readouterr().err
        assert len(said.strip().splitlines()) == 1
        return said

    assert "no such folder; docs/learned_models.md" in refused(tmp_path / "nowhere")
    said = refused(tmp_path / "models")
    for name in ("grounding-dino (", "scaled_online.pth (", "vggt/model.pt ("):
        assert name in said
    assert "sam2 (" not in said
    assert "trellis" not in said
    assert "trellis (" in refused(tmp_path / "models", "--completion", "generated")
    assert not (tmp_path / "out").exists()


def test_builds_from_video_name_them_too(tmp_path):
    """The way of `twin_node`, whose parameters are these options."""
    source = EpisodeSource(source=Source.VIDEO, perception=learned())
    with pytest.raises(LearnedModelError, match="weights models: no such folder"):
        load_episodes([bag(tmp_path / "bag", video("sheet")[:2])], source)


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> Path:
    """A folder of weights: tiny random models, and what stands in for those whose packages are not on PyPI."""
    torch = pytest.importorskip("torch", reason="needs the extra [learned]")
    pytest.importorskip("transformers", reason="needs the extra [learned]")
    folder = tmp_path_factory.mktemp("weights")
    save_grounding_dino(folder / "grounding-dino")
    save_sam2(folder / "sam2")
    (folder / "vggt").mkdir()
    torch.save({}, folder / "vggt/model.pt")
    torch.save({}, folder / "scaled_online.pth")
    return folder


class Predictor:
    """Stands in for CoTracker3 up to the queries, which are of what SAM 2 made of the boxes of Grounding DINO."""

    step = 4
    queries = None

    def to(self, device):
        return self

    def __call__(self, chunk, *, is_first_step, queries):
        Predictor.queries = queries
        raise EpisodeError("far enough")


@pytest.fixture
def packages(monkeypatch) -> None:
    import torch

    tracker, mapper = ModuleType("cotracker.predictor"), ModuleType("vggt.models.vggt")
    tracker.CoTrackerOnlinePredictor = lambda checkpoint: Predictor()
    mapper.VGGT = torch.nn.Identity
    for name in ("cotracker", "vggt", "vggt.models"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "cotracker.predictor", tracker)
    monkeypatch.setitem(sys.modules, "vggt.models.vggt", mapper)


def test_models_in_the_folder_are_loaded_and_asked(models, packages, tmp_path, capsys):
    path = bag(tmp_path / "bag", video("sheet")[:20])
    options = ["--stages", "learned", "--weights", str(models), "--object-prompt", "a towel", "--side", "140"]
    assert main(["perceive", str(path), "--out", str(tmp_path / "out"), *options]) == 2
    assert "far enough" in capsys.readouterr().err
    assert Predictor.queries.shape[1] > 10
    assert not (tmp_path / "out").exists()


def test_package_that_is_missing_is_named(models, monkeypatch):
    from egophys_core.perception.learned import load_stages

    monkeypatch.setitem(sys.modules, "cotracker.predictor", None)
    with pytest.raises(LearnedModelError, match=r"cannot import cotracker.predictor.*install it"):
        load_stages(PerceptionOptions(stages="learned", weights=str(models)))
