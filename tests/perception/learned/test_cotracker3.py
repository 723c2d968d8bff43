"""The adapters of CoTracker3 with stand-ins for its predictors.

The package `cotracker` is not on PyPI and its weights are not here, so the model itself is not run. The stand-ins take
and return what `cotracker/predictor.py` says and answer with the true motion of a red spot, which they find in the
video they are given; the online one keeps the state of the real one: a first call that only starts, then windows of at
most two steps, each a step after the one before, and tracks of all views so far.
"""

import sys
from types import ModuleType

import numpy as np
import pytest

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.cotracker3 import CoTracker3Offline, CoTracker3Online
from egophys_core.perception.learned.weights import LearnedModelError
from egophys_core.perception.stages import View

torch = pytest.importorskip("torch", reason="torch is not installed (pip install .[learned])")

HEIGHT, WIDTH = 40, 60
QUERIES = np.array([[10.5, 20.25], [30.0, 5.0], [59.0, 39.0]])


def spot(index: int) -> tuple[int, int]:
    """x, y of the spot, which goes to the right."""
    return 8 + index, 20


def view_at(index: int) -> View:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 1] = index  # green tells the view
    x, y = spot(index)
    image[y, x] = (0, index, 255)
    return View(stamp_ns=index, image=image, camera_matrix=np.eye(3), world_from_camera=np.eye(4))


def places(video) -> tuple[np.ndarray, list[int]]:
    """[T, 2] of the spot and the numbers of the views, of video as a predictor gets it."""
    assert video.dtype == torch.float32
    assert video.shape[0] == 1
    assert video.shape[2:] == (3, HEIGHT, WIDTH)
    assert float(video.max()) == 255.0
    assert not video[0, :, 2].any()  # blue last: nothing is blue
    found = [divmod(int(each[0].argmax()), WIDTH)[::-1] for each in video[0]]
    return np.array(found, float), [int(each[1, 0, 0]) for each in video[0]]


def moved(queries, shifts: np.ndarray):
    assert queries.dtype == torch.float32
    assert queries.shape == (1, len(QUERIES), 3)
    assert not queries[..., 0].any()
    torch.testing.assert_close(queries[0, :, 1:], torch.tensor(QUERIES, dtype=torch.float32))
    tracks = queries[:, None, :, 1:] + torch.tensor(shifts, dtype=torch.float32)[None, :, None]
    # Two hundredths off and not visible in the first view, as the online predictor may say.
    visible = torch.ones(tracks.shape[:3], dtype=torch.bool)
    visible[:, 0] = False
    visible[:, 1:, 1] = False
    return tracks + 0.02, visible


class Offline(torch.nn.Module):
    def forward(self, video, queries):
        found, numbers = places(video)
        assert numbers == list(range(len(numbers)))
        return moved(queries, found - found[0])


class Online(torch.nn.Module):
    step = 4

    def forward(self, video_chunk, is_first_step=False, queries=None, grid_size=5, add_support_grid=False):
        found, numbers = places(video_chunk)
        if is_first_step:
            self.queries, self.start, self.found = queries, 0, np.zeros((0, 2))
            return None, None
        assert len(numbers) <= 2 * self.step
        assert numbers == list(range(self.start, self.start + len(numbers)))
        assert len(numbers) > self.step or self.start == 0
        self.found = np.concatenate([self.found[: self.start], found])
        self.start += self.step
        return moved(self.queries, self.found - self.found[0])


@pytest.mark.parametrize("length", [1, 2, 3, 4, 5, 7, 8, 9, 11, 12, 13, 16, 29, 32])
@pytest.mark.parametrize("kind", [lambda: CoTracker3Offline(Offline()), lambda: CoTracker3Online(Online())])
def test_tracks_are_those_of_the_model(kind, length):
    tracks = kind().tracks((view_at(index) for index in range(length)), QUERIES)
    expected = QUERIES + np.arange(length)[:, None, None] * [1.0, 0.0]
    np.testing.assert_allclose(tracks.pixels, expected, atol=0.03)
    assert tracks.pixels.dtype == np.float32
    assert (tracks.pixels[0] == QUERIES.astype(np.float32)).all()
    assert tracks.visible[0].all()
    assert tracks.visible[1:, 0].all()
    assert not tracks.visible[1:, 1].any()  # the model says hidden
    assert not tracks.visible[1:, 2].any()  # out of the image to the right


def test_a_tracker_starts_anew_for_each_video():
    tracker = CoTracker3Online(Online())
    first, second = (tracker.tracks([view_at(index) for index in range(10)], QUERIES) for _ in range(2))
    np.testing.assert_array_equal(first.pixels, second.pixels)


def test_the_online_tracker_holds_no_more_than_two_steps():
    taken = 0

    class Counting(Online):
        def forward(self, video_chunk, **options):
            assert taken - (0 if not hasattr(self, "start") else self.start) <= 2 * self.step
            return super().forward(video_chunk, **options)

    def views():
        nonlocal taken
        for index in range(30):
            taken += 1
            yield view_at(index)

    assert len(CoTracker3Online(Counting()).tracks(views(), QUERIES).visible) == 30


@pytest.mark.parametrize("tracker", [CoTracker3Offline(Offline()), CoTracker3Online(Online())])
def test_bad_queries_and_no_views_are_told(tracker):
    with pytest.raises(EpisodeError, match="no views"):
        tracker.tracks([], QUERIES)
    with pytest.raises(EpisodeError, match="no views"):
        tracker.tracks([], np.zeros((0, 2)))
    with pytest.raises(EpisodeError, match=r"\[N, 2\]"):
        tracker.tracks([view_at(0)], np.zeros((3, 3)))
    for bad in ([60.0, 5.0], [5.0, 40.0], [-1.0, 5.0], [np.nan, 5.0]):
        with pytest.raises(EpisodeError, match="query 1 at"):
            tracker.tracks([view_at(0)], np.array([[5.0, 5.0], bad]))


@pytest.mark.parametrize("tracker", [CoTracker3Offline(Offline()), CoTracker3Online(Online())])
def test_no_queries_are_no_tracks(tracker):
    tracks = tracker.tracks((view_at(index) for index in range(9)), np.zeros((0, 2)))
    assert tracks.pixels.shape == (9, 0, 2)
    assert tracks.visible.shape == (9, 0)


def test_places_that_are_not_numbers_are_not_visible():
    class Broken(Offline):
        def forward(self, video, queries):
            tracks, visible = super().forward(video, queries)
            return tracks * float("nan"), visible

    tracks = CoTracker3Offline(Broken()).tracks([view_at(0), view_at(1)], QUERIES)
    assert tracks.visible[0].all()
    assert not tracks.visible[1].any()


@pytest.mark.parametrize("kind", [CoTracker3Offline, CoTracker3Online])
def test_loading_says_what_is_missing(kind, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cotracker.predictor", None)
    with pytest.raises(LearnedModelError, match=r"github.com/facebookresearch/co-tracker"):
        kind.load(tmp_path / "scaled.pth")
    package = ModuleType("cotracker.predictor")
    package.CoTrackerPredictor = package.CoTrackerOnlinePredictor = lambda checkpoint: torch.load(checkpoint)
    monkeypatch.setitem(sys.modules, "cotracker", ModuleType("cotracker"))
    monkeypatch.setitem(sys.modules, "cotracker.predictor", package)
    with pytest.raises(LearnedModelError, match=r"scaled.pth: no such file"):
        kind.load(tmp_path / "scaled.pth")
    (tmp_path / "scaled.pth").write_bytes(b"no weights")
    with pytest.raises(LearnedModelError, match=r"cannot read it .*scaled_online.pth"):
        kind.load(tmp_path / "scaled.pth")


def test_a_device_that_is_not_there_is_told():
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    # A module without parameters moves anywhere.
    model = Offline()
    model.weight = torch.nn.Parameter(torch.zeros(1))
    with pytest.raises(LearnedModelError, match="cannot use device 'cuda'"):
        CoTracker3Offline(model, device="cuda")
