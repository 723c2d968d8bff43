"""The adapter of VGGT with a stand-in for the model.

The package `vggt` is not on PyPI and its weights are not here, so the model itself is not run. The stand-in takes and
returns what the model's code says (shapes, ranges, names, camera from world, scalar-last quaternions) and answers with
the depths and cameras of a known scene in a unit and frame of its own.
"""

from itertools import pairwise

import numpy as np
import pytest

from egophys_core.errors import EpisodeError, OptionsError
from egophys_core.perception.learned.similarity import Similarity
from egophys_core.perception.learned.vggt import KnownLength, Vggt, cameras, confidence
from egophys_core.perception.learned.weights import LearnedModelError
from tests.perception.learned.scene import SIZE, pose_at, true_depth, true_points, view_at
from tests.perception.learned.test_similarity import turn

torch = pytest.importorskip("torch", reason="torch is not installed (pip install .[learned])")

OWN = Similarity(scale=4.3, rotation=turn((1, -2, 0.5), 70), translation=np.array([3.0, 1.0, -2.0]))
"""The model's frame from the world."""


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """x y z w of a rotation, by the eigenvector of Shepperd's matrix."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    return np.linalg.eigh(k)[1][:, -1]


class VggtStandIn(torch.nn.Module):
    """Tells the views by the red channel, which holds their number."""

    def __init__(self, *, certainty: float = 20.0, unit_of: list[float] | None = None, motion: float = 1.0) -> None:
        super().__init__()
        self.certainty = certainty
        self.units = unit_of or [OWN.scale]
        self.motion = motion
        self.calls: list[list[int]] = []

    def forward(self, images):
        assert images.ndim == 4
        assert images.shape[1:] == (3, SIZE, SIZE)
        assert images.dtype == torch.float32
        torch.testing.assert_close(images[:, 1:].amax(dim=(0, 2, 3)), torch.tensor([100 / 255, 200 / 255]))
        numbers = [round(255 * float(each[0, 0, 0])) for each in images]
        unit = self.units[min(len(self.calls), len(self.units) - 1)]
        self.calls.append(numbers)
        poses = [pose_at(number, motion=self.motion) for number in numbers]
        encodings, depths = [], []
        for pose in poses:
            rotation = pose[:3, :3].T @ OWN.rotation.T
            centre = unit * OWN.rotation @ pose[:3, 3] + OWN.translation
            encodings.append([*(-rotation @ centre), *quaternion(rotation), 0.75, 0.75])
            depths.append(unit * true_depth(pose))
        depth = torch.tensor(np.stack(depths), dtype=torch.float32)[None, ..., None]
        return {
            "pose_enc": torch.tensor(encodings, dtype=torch.float32)[None],
            "depth": depth,
            "depth_conf": torch.full(depth.shape[:-1], self.certainty),
        }


def largest_error(maps, poses) -> float:
    return max(
        float(np.linalg.norm(each.points - true_points(pose), axis=-1).max())
        for each, pose in zip(maps, poses, strict=True)
    )


@pytest.mark.parametrize("views", [0, 1, 2, 4, 5, 9])
@pytest.mark.parametrize(("window", "overlap"), [(1, 0), (4, 0), (4, 2), (3, 1), (16, 4)])
def test_every_view_gets_its_map_once_and_in_order(views, window, overlap):
    model = VggtStandIn()
    mapper = Vggt(model, window=window, overlap=overlap)
    maps = list(mapper.point_maps(view_at(index) for index in range(views)))
    assert len(maps) == len(mapper.poses) == views
    assert max((len(call) for call in model.calls), default=0) <= window
    assert sorted({number for call in model.calls for number in call}) == list(range(views))
    if views:
        assert largest_error(maps, [pose_at(index) for index in range(views)]) < 1e-5
        assert maps[0].points.dtype == maps[0].confidence.dtype == np.float32
        assert maps[0].confidence.max() == pytest.approx(0.95)


def test_views_are_taken_only_as_far_as_they_are_needed():
    taken = []

    def views():
        for index in range(100):
            taken.append(index)
            yield view_at(index)

    maps = Vggt(VggtStandIn(), window=4, overlap=1).point_maps(views())
    next(maps)
    assert len(taken) == 4


def test_a_view_without_a_pose_gets_one_from_the_others():
    mapper = Vggt(VggtStandIn(), window=4, overlap=1)
    maps = list(mapper.point_maps(view_at(index, has_pose=index not in (0, 5, 6)) for index in range(8)))
    poses = [pose_at(index) for index in range(8)]
    assert largest_error(maps, poses) < 1e-4
    np.testing.assert_allclose(np.stack(mapper.poses), np.stack(poses), atol=1e-4)


def test_with_a_still_head_a_lost_board_is_bridged_by_the_views_shared_although_the_unit_changes():
    mapper = Vggt(VggtStandIn(unit_of=[4.3, 0.7, 2.0], motion=0.0), window=4, overlap=2)
    maps = list(mapper.point_maps(view_at(index, has_pose=index < 3, motion=0.0) for index in range(8)))
    assert largest_error(maps, [pose_at(0)] * 8) < 1e-4


def test_where_no_table_is_believed_the_motion_of_the_camera_tells_the_scale():
    moving = Vggt(VggtStandIn(motion=5.0), window=6, table_area=(8, 9, 8, 9))
    maps = list(moving.point_maps(view_at(index, motion=5.0) for index in range(6)))
    assert largest_error(maps, [pose_at(index, motion=5.0) for index in range(6)]) < 1e-4


def test_without_a_board_a_known_length_gives_metres_and_the_table_is_level():
    pose = pose_at(0)
    ends = ((5, 50), (50, 52))
    points = true_points(pose)
    metres = float(np.linalg.norm(points[50, 5] - points[52, 50]))
    mapper = Vggt(
        VggtStandIn(), window=3, overlap=1, known_length=KnownLength(first=ends[0], second=ends[1], metres=metres)
    )
    maps = list(mapper.point_maps(view_at(index, has_pose=False) for index in range(5)))
    for index, each in enumerate(maps):
        np.testing.assert_allclose(each.points[..., 2], true_points(pose_at(index))[..., 2], atol=1e-4)
    assert np.linalg.norm(maps[0].points[50, 5] - maps[0].points[52, 50]) == pytest.approx(metres, rel=1e-4)
    # The same pixel of the table is seen at the same place from all views.
    steps = [np.linalg.norm(b.points[40, 40] - a.points[40, 40]) for a, b in pairwise(maps)]
    wanted = [np.linalg.norm(true_points(pose_at(i + 1))[40, 40] - true_points(pose_at(i))[40, 40]) for i in range(4)]
    np.testing.assert_allclose(steps, wanted, atol=1e-4)


def test_without_board_and_length_it_is_said_what_to_do():
    with pytest.raises(EpisodeError, match=r"arbitrary.*known length"):
        list(Vggt(VggtStandIn(), window=2).point_maps(view_at(index, has_pose=False) for index in range(4)))


def test_views_that_cannot_be_anchored_are_unknown_and_do_not_end_the_run():
    maps = list(Vggt(VggtStandIn()).point_maps(view_at(index, has_pose=index != 1) for index in range(3)))
    assert np.isnan(maps[1].points).all()
    assert not maps[1].confidence.any()
    assert np.isfinite(maps[2].points).all()


def test_what_the_model_does_not_believe_gives_no_scale():
    with pytest.raises(EpisodeError, match="arbitrary"):
        list(Vggt(VggtStandIn(certainty=1.0)).point_maps([view_at(0)]))


@pytest.mark.parametrize(
    ("certainty", "expected"), [(1.0, 0.0), (2.0, 0.5), (4.0, 0.75), (np.inf, 1.0), (0.3, 0.0), (np.nan, 0.0)]
)
def test_confidence_is_one_minus_its_inverse(certainty, expected):
    assert confidence(np.array([certainty]))[0] == pytest.approx(expected)


def test_cameras_of_encodings():
    rotation, centre = turn((2, -1, 1), 50), np.array([1.0, 2.0, 3.0])
    encoding = np.array([[*(-rotation @ centre), *(-3 * quaternion(rotation)), 1, 1]])
    found = cameras(encoding)
    np.testing.assert_allclose(found[0][0], rotation, atol=1e-12)
    np.testing.assert_allclose(found[1][0], centre, atol=1e-12)


def test_images_must_be_of_whole_patches():
    view = view_at(0)
    odd = type(view)(
        stamp_ns=0, image=view.image[:-1], camera_matrix=view.camera_matrix, world_from_camera=view.world_from_camera
    )
    with pytest.raises(EpisodeError, match="multiples of 14, got \\(55, 56\\)"):
        list(Vggt(VggtStandIn()).point_maps([odd]))


@pytest.mark.parametrize(("window", "overlap"), [(1, 1), (4, 4), (4, -1), (0, 0)])
def test_windows_that_do_not_advance_are_refused(window, overlap):
    with pytest.raises(OptionsError, match="overlap"):
        Vggt(VggtStandIn(), window=window, overlap=overlap)


@pytest.mark.parametrize(
    "length",
    [
        KnownLength(first=(0, 0), second=(SIZE, 0), metres=0.1),
        KnownLength(first=(3, 3), second=(3, 3), metres=0.1),
        KnownLength(first=(3, 3), second=(9, 3), metres=0.0),
    ],
)
def test_a_known_length_must_be_in_the_view_and_above_0(length):
    with pytest.raises(EpisodeError, match="known length"):
        list(Vggt(VggtStandIn(), known_length=length).point_maps([view_at(0, has_pose=False)]))


def test_the_missing_package_and_missing_weights_are_told(tmp_path):
    with pytest.raises(LearnedModelError, match=r"github.com/facebookresearch/vggt|no such file"):
        Vggt.load(tmp_path / "model.pt")
