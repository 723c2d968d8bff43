"""Observations of a drawn video, as perception would give them: a level object that a hand pushes."""

from dataclasses import replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.perception.observation import Observation
from egophys_core.perception.perceive import Perceived, PerceptionReport
from egophys_core.perception.remarks import Level, Remark
from egophys_core.perception.seconds import Second
from egophys_core.perception.surface.surface_mesh import mesh_of_mask
from tests.perception.table_scene import CAMERA, Scene, draw, project

START_NS = 1_700_000_000_000_000_000
HEIGHT_M = 0.008


def observations(
    frames: int = 14, *, points: int = 200, first: int = 0, scene: Scene | None = None
) -> list[Observation]:
    """Exact ones of `frames` views from `first` on; the object is pushed from frame 20 on."""
    scene = scene or Scene()
    rng = np.random.default_rng(1)
    view, masks = draw(scene, 0)
    mesh = mesh_of_mask(masks.object, 9.0)
    rest = on_table(mesh.pixels, view.world_from_camera)
    rows, columns = np.nonzero(masks.object)
    chosen = rng.choice(len(rows), points, replace=False)
    followed = on_table(np.column_stack([columns, rows])[chosen].astype(float), view.world_from_camera)
    found = []
    for frame in range(first, first + frames):
        view, masks = draw(scene, frame)
        view = replace(view, stamp_ns=START_NS + view.stamp_ns)
        shift = np.array([*scene.push, 0]) * max(0, frame - 20)
        places = followed + shift
        pixels = project(places, view.world_from_camera)
        x, y = np.rint(pixels).astype(int).T.clip(0, len(masks.object) - 1)
        visible = masks.object[y, x]
        found.append(
            Observation(
                view=view,
                masks=masks,
                points=places,
                confidence=np.where(visible, rng.uniform(0.5, 1, points), rng.uniform(0.05, 0.4, points)),
                pixels=pixels,
                visible=visible,
                mesh_pixels=project(rest + shift, view.world_from_camera),
                mesh_edges=mesh.edges,
                hand_points=np.tile(shift, (5, 1)) + [[0.02 * k, 0.05, 0.03] for k in range(5)],
                hands={},
            )
        )
    return found


def perceived_from(seen: list[Observation], *, noise_m: float = 0.0) -> Perceived:
    """The episode of observations, its object points off by noise of this deviation along each axis."""
    rng = np.random.default_rng(2)
    stamps = np.array([each.view.stamp_ns for each in seen], np.int64)
    points = np.stack([each.points for each in seen])
    points = np.where(np.stack([each.visible for each in seen])[..., None], points, np.nan)
    points = (points + rng.normal(0, noise_m, points.shape)).astype(np.float32)
    hands = np.stack([each.hand_points for each in seen]).astype(np.float32)
    episode = Episode(
        name="drawn",
        times=(stamps - stamps[0]) * 1e-9,
        points=points,
        confidence=np.isfinite(points).all(axis=2).astype(np.float32),
        point_ids=np.arange(points.shape[1], dtype=np.uint32),
        controllers=hands,
        controller_ids=np.arange(hands.shape[1], dtype=np.uint32),
    )
    report = PerceptionReport(
        frames=len(seen),
        posed=len(seen),
        pose_inferred=0,
        scale_is_known=True,
        kind="sheet",
        thickness_m=HEIGHT_M,
        tracked=points.shape[1],
        coverage=0.9,
        hand_seen=3,
        grip_frame=-1,
        notes=("the hand never takes hold",),
        seconds=(Second(start_s=0.0, coverage=0.12, doubtful=0.5, confidence=np.nan, hands=1, touching=0),),
        remarks=(
            Remark(name="camera", level=Level.DOUBTFUL, text="pose of a few", advice="lay the board in view"),
            Remark(name="hands", level=Level.BAD, text="the object never moves with it", advice="touch it"),
        ),
    )
    return Perceived(episode=episode, start_ns=int(stamps[0]), report=report)


def on_table(pixels: np.ndarray, world_from_camera: np.ndarray) -> np.ndarray:
    """[N, 3] metres: where pixels [N, 2] show the top of the drawn object."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ (world_from_camera[:3, :3] @ np.linalg.inv(CAMERA)).T
    eye = world_from_camera[:3, 3]
    return eye + rays * ((HEIGHT_M - eye[2]) / rays[:, 2])[:, None]
