"""Targets as text: each kind of shape, its edits, and what is wrong with those that are none."""

import numpy as np
import pytest
import trimesh

from egophys_core.errors import EgophysError, PlanningError
from egophys_core.planning import TargetText, parse_target, target_points
from egophys_core.recording import write_episode
from egophys_core.twin import save_twin
from tests.identification.synthetic import sheet_episode
from tests.twin.examples import make_twin

PRESENT = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.1, 0.0], [0.2, 0.1, 0.0]])
CLOUD = PRESENT + [0.05, 0.1, 0.02]


def points_of(text):
    return target_points(parse_target(str(text)), PRESENT)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("target") / "a towel"
    write_episode(sheet_episode(), folder)
    return folder


def test_a_text_is_a_shape_and_what_is_done_to_it():
    assert parse_target(" a towel.mcap@2.3s  rotate=0,0,45 translate=0.1,-.2,1e-2 ") == TargetText(
        source="a towel.mcap@2.3s", translate=(0.1, -0.2, 0.01), rotate=(0.0, 0.0, 45.0)
    )
    assert parse_target("other.twin") == TargetText(source="other.twin")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "names no shape"),
        ("translate=0.1,0,0", "names no shape"),
        ("present", "add translate=X,Y,Z or rotate=R,P,Y"),
        ("present translate=0,0,0", "the present shape is no target as it is"),
        ("present translat=0.1,0,0", "unknown edit translat="),
        ("present translate=0.1,0", "translate= must be three numbers without blanks, like 0.1,0,0; got '0.1,0'"),
        ("present translate=0.1,nan,0", "must be three numbers"),
        ("present rotate=a,b,c", "rotate= must be three numbers"),
        ("present rotate=0,0,1 rotate=0,0,2", "rotate= stands there twice"),
    ],
)
def test_texts_that_are_no_targets(text, reason):
    with pytest.raises(PlanningError, match=reason):
        parse_target(text)


def test_a_shape_is_turned_about_its_centre_then_shifted():
    turned = points_of("present rotate=0,0,90 translate=0,0,0.1")
    # Of the rectangle of 20 cm by 10 cm about (10 cm, 5 cm).
    assert turned == pytest.approx(
        np.array([[0.15, -0.05, 0.1], [0.15, 0.15, 0.1], [0.05, -0.05, 0.1], [0.05, 0.15, 0.1]])
    )
    tipped = points_of("present rotate=90,0,0")
    assert tipped[:, 2] == pytest.approx([-0.05, -0.05, 0.05, 0.05])


PCD = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS rgb x y z normal
SIZE 4 4 4 4 4
TYPE U F F F F
COUNT 1 1 1 1 2
WIDTH 4
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 4
DATA """


def write_clouds(folder):
    np.save(folder / "cloud.npy", CLOUD)
    trimesh.PointCloud(CLOUD).export(folder / "cloud.ply")
    rows = [" ".join(map(repr, row)) for row in CLOUD.tolist()]
    (folder / "cloud.xyz").write_text("\n".join(rows))
    (folder / "named.csv").write_text("id,Z,Y,X\n" + "\n".join(f"1,{z!r},{y!r},{x!r}" for x, y, z in CLOUD.tolist()))
    (folder / "bare.csv").write_text("# metres\n" + "\n".join(f"{x!r};{y!r};{z!r};0" for x, y, z in CLOUD.tolist()))
    (folder / "ascii.pcd").write_text(PCD + "ascii\n" + "\n".join(f"7 {row} 0 1" for row in rows))
    kinds = [("rgb", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("normal", "<f4", 2)]
    table = np.zeros(4, kinds)
    for name, column in zip("xyz", CLOUD.T, strict=True):
        table[name] = column
    (folder / "binary.pcd").write_bytes((PCD + "binary\n").encode() + table.tobytes())


@pytest.mark.parametrize(
    "name", ["cloud.npy", "cloud.ply", "cloud.xyz", "named.csv", "bare.csv", "ascii.pcd", "binary.pcd"]
)
def test_a_cloud_is_read_from_files_of_any_kind(tmp_path, name):
    write_clouds(tmp_path)
    assert points_of(tmp_path / name) == pytest.approx(CLOUD, abs=1e-7)
    assert points_of(f"{tmp_path / name} translate=0,0,1") == pytest.approx(CLOUD + [0, 0, 1], abs=1e-7)


def test_a_frame_of_a_bag_by_index_or_time_is_what_was_seen_then(bag):
    episode = sheet_episode()
    assert points_of(bag) == pytest.approx(episode.points[-1], abs=1e-6)
    assert points_of(f"{bag}@20") == pytest.approx(episode.points[20], abs=1e-6)
    assert points_of(f"{bag}@1.01s rotate=0,0,0") == pytest.approx(episode.points[30], abs=1e-6)
    assert points_of(f"{next(bag.glob('*.mcap'))}@0") == pytest.approx(episode.points[0], abs=1e-6)


def test_another_twin_is_its_surface_at_rest(tmp_path):
    twin = make_twin()
    save_twin(twin, tmp_path / "other.twin")
    assert points_of(tmp_path / "other.twin") == pytest.approx(twin.model.graph.positions, abs=1e-6)


def test_a_dense_cloud_is_thinned(tmp_path):
    np.save(tmp_path / "dense.npy", np.random.default_rng(0).uniform(0, 0.2, (50_000, 3)))
    assert len(points_of(tmp_path / "dense.npy")) == pytest.approx(50_000 / 3, abs=1)


def test_shapes_that_are_none_are_refused_with_the_reason(tmp_path, bag):
    write_clouds(tmp_path)
    for name, points in (
        ("empty", np.zeros((0, 3))),
        ("holes", np.array([[0, 0, 0], [np.nan, 0, 0]])),
        ("millimetres", 1000 * CLOUD),
        ("far", CLOUD + [0, 0, 4.0]),
        ("flat", np.zeros((4, 2))),
    ):
        np.save(tmp_path / f"{name}.npy", points)
    np.save(tmp_path / "pickled.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    texts = {
        "text.npy": "hello",
        "text.ply": "hello",
        "cut.pcd": PCD[:80],
        "words.csv": "a,b,c\n1,2,3",
        "short.xyz": "1 2",
    }
    for name, content in {**texts, "packed.pcd": PCD + "binary_compressed\n", "shape.txt": "1 2 3"}.items():
        (tmp_path / name).write_text(content)
    last = sheet_episode().frames - 1
    for source, reason in (
        ("empty.npy", "has no points"),
        ("holes.npy", "1 of 2 points are not finite, point 1 the first"),
        ("millimetres.npy", "224 m across, more than 3 m; points must be in metres.*divide millimetres by 1000"),
        ("far.npy", r"4.0\d m from the object"),
        ("flat.npy", r"must be \[P, 3\] points in metres, got float64 \(4, 2\)"),
        ("pickled.npy", "cannot read target"),
        ("text.npy", "cannot read target"),
        ("text.ply", "cannot read target.*not a readable .ply file"),
        ("cut.pcd", "its header lacks"),
        ("packed.pcd", "its data are binary_compressed; write it as ascii or binary"),
        ("words.csv", "names no x, y and z: a b c"),
        ("short.xyz", "cannot read target"),
        ("no.npy", "cannot read target.*No such file"),
        ("no.mcap", "no such file"),
        ("no", "there is no such file or folder; give `present`, or a file"),
        ("shape.txt", "files that hold a shape are .npy, .*not .txt"),
        ("cloud.npy@3", "only a bag has frames, leave @3 out"),
    ):
        with pytest.raises(EgophysError, match=reason):
            points_of(tmp_path / source)
    for frame, reason in (
        ("99s", rf"shows 0 .. {last / 30:.2f} s, not 99 s"),
        ("999", f"has frames 0 .. {last}, not 999"),
        ("-1", "after @ stands a frame"),
        ("2.3", "not '2.3'"),
    ):
        with pytest.raises(EgophysError, match=reason):
            points_of(f"{bag}@{frame}")


def test_points_in_another_frame_are_no_target(tmp_path):
    write_episode(sheet_episode(), tmp_path / "towel", frame="camera")
    with pytest.raises(PlanningError, match="the points are in frame 'camera', needed is 'world'"):
        points_of(tmp_path / "towel")
