"""The picture of the README: frames of the shipped video, and in the same frames its twin, moved by the hand alone.

perceive -> build -> simulate -> the twin's springs, projected by the camera poses that perception found
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from egophys_core.cli.main import main as egophys
from egophys_core.episode import Episode
from egophys_core.files import write_atomically
from egophys_core.perception.observation import Observation
from egophys_core.perception.perceive import perceive
from egophys_core.perception.stages import View
from egophys_core.perception.surface.surface_render import project
from egophys_core.recording import read_episode, write_episode
from egophys_core.twin import SpringKind, load_twin

REPOSITORY = Path(__file__).resolve().parents[1]
VIDEO = REPOSITORY / "examples/towel_lift_video.mcap"
SHARES = (0.1, 0.3, 0.5, 0.75, 0.97)
"""Of the video, at which frames are shown."""
WIDTH, MARGIN, CAPTION = 300, 25, 26
"""Of a frame in the picture, around the object in the view, and the height of the text: pixels."""
SPRING, HAND, INK = (60, 200, 255), (90, 255, 120), (40, 40, 40)
"""Colours, BGR."""


def main() -> int:
    """Make the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "docs/images/twin.jpg", help="JPEG file to write")
    parser.add_argument("--generations", type=int, default=50, help="generations of the fit")
    parsed = parser.parse_args()
    views: list[View] = []

    def keep(observation: Observation) -> None:
        views.append(observation.view)

    episode = perceive(VIDEO, on_observation=keep).episode
    with TemporaryDirectory() as made:
        folder = Path(made)
        write_episode(episode, folder / "seen")
        twin, predicted = folder / "towel.twin", folder / "predicted"
        for words in (
            ["build", folder / "seen", "--out", twin, "--generations", parsed.generations],
            ["simulate", twin, folder / "seen", "--out", predicted],
        ):
            if egophys([str(word) for word in words]) != 0:
                return 2
        picture = draw(episode, views, read_episode(predicted).points, springs_of(twin))
    write_atomically(parsed.out, bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 88])[1]))
    print(f"{parsed.out} written")
    return 0


def springs_of(twin: Path) -> np.ndarray:
    """[S, 2] springs of the surface, as indices of its points."""
    graph = load_twin(twin).model.graph
    place = np.cumsum(graph.surface) - 1
    shown = graph.surface[graph.springs].all(axis=1) & (graph.kinds == SpringKind.STRUCTURAL)
    return np.asarray(place[graph.springs[shown]])


def draw(episode: Episode, views: list[View], predicted: np.ndarray, springs: np.ndarray) -> np.ndarray:
    """The frames above, the twin in them below; captions say which of them were fitted."""
    frames = [round(share * (len(views) - 1)) for share in SHARES]
    pixels = {frame: _pixels(predicted[frame], views[frame]) for frame in frames}
    hands = {frame: _pixels(episode.controllers[frame], views[frame]) for frame in frames}
    everywhere = np.concatenate([*pixels.values(), *hands.values()])
    low = np.maximum(everywhere.min(axis=0) - MARGIN, 0).astype(int)
    high = np.minimum(everywhere.max(axis=0) + MARGIN, len(views[0].image)).astype(int)
    columns = []
    for frame in frames:
        image = views[frame].image
        said = f"{episode.times[frame]:.1f} s, {'fitted' if frame < episode.train_frames else 'not fitted'}"
        both = [image, _with_twin(image, pixels[frame], springs, hands[frame])]
        columns.append(np.concatenate([_caption(said), *(_cut(each, low, high) for each in both)]))
    return np.concatenate(columns, axis=1)


def _pixels(points: np.ndarray, view: View) -> np.ndarray:
    return project(points.astype(float), view.camera_matrix, view.world_from_camera)[:, :2]


def _with_twin(image: np.ndarray, pixels: np.ndarray, springs: np.ndarray, hands: np.ndarray) -> np.ndarray:
    drawn = (image * 0.45).astype(np.uint8)
    for one, other in np.rint(pixels[springs] * 16).astype(int):
        cv2.line(drawn, one.tolist(), other.tolist(), SPRING, 1, cv2.LINE_AA, shift=4)
    for hand in np.rint(hands).astype(int):
        cv2.circle(drawn, hand.tolist(), 2, HAND, -1, cv2.LINE_AA)
    return drawn


def _cut(image: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    cut = image[low[1] : high[1], low[0] : high[0]]
    size = WIDTH, round(WIDTH * len(cut) / cut.shape[1])
    scaled = cv2.resize(cut, size, interpolation=cv2.INTER_AREA)
    return cv2.copyMakeBorder(scaled, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255))


def _caption(text: str) -> np.ndarray:
    strip = np.full((CAPTION, WIDTH + 4, 3), 255, np.uint8)
    cv2.putText(strip, text, (6, CAPTION - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return strip


if __name__ == "__main__":
    sys.exit(main())
