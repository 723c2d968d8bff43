"""Landmarks of real hands by MediaPipe Hands, run by OpenCV.

Zhang et al., "MediaPipe Hands: On-device Real-time Hand Tracking", 2020. The models are those that OpenCV Zoo publishes
as ONNX, February 2023: one finds palms in a small picture of the whole view, the other landmarks in a picture of one
hand, upright. Pictures are RGB from 0 to 1, [1, side, side, 3].
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from egophys_core.perception.learned.weights import PAGE, LearnedModelError, require_file
from egophys_core.perception.stages import HandLandmarks, View

PALM_FILE = "palm_detection_mediapipe_2023feb.onnx"
POSE_FILE = "handpose_estimation_mediapipe_2023feb.onnx"

PALM_SIDE, POSE_SIDE = 192, 224
"""Pixels."""
PALM_GRIDS = ((24, 2), (12, 6))
"""Cells along a side, and anchors in each."""
ANCHORS = sum(cells**2 * each for cells, each in PALM_GRIDS)
PALM_NUMBERS = 18
"""Of an anchor: middle and size of a box, then x, y of seven places of a palm; pixels from the anchor."""
WRIST, MIDDLE_KNUCKLE = 0, 2
"""Among the seven places."""
LANDMARKS = 21

SAME_PALM = 0.3
"""Boxes that share more of their union than this are of one palm."""
MOST_HANDS = 2
HAND_IN_PALMS, HAND_AHEAD = 2.6, 0.5
"""Side of the picture of a hand, and how far its middle is ahead of that of the palm, in sides of the palm's box."""

Network = Callable[[np.ndarray], Sequence[np.ndarray]]
"""A picture [1, side, side, 3] float32 -> the outputs."""


@dataclass(frozen=True, kw_only=True)
class HandPicture:
    """Where the upright picture of a hand lies in its view."""

    middle: np.ndarray
    """[2] pixels of the view."""
    axes: np.ndarray
    """[2, 2] columns: the picture's directions to the right and down in the view, of length 1."""
    scale: float
    """Pixels of the view per pixel of the picture."""

    def cut(self, image: np.ndarray) -> np.ndarray:
        """[POSE_SIDE, POSE_SIDE, 3] uint8 of a view's image; black beyond its border."""
        turn = self.scale * self.axes
        corner = self.middle - turn @ np.full(2, (POSE_SIDE - 1) / 2)
        matrix = np.column_stack([turn, corner])
        return np.asarray(
            cv2.warpAffine(image, matrix, (POSE_SIDE, POSE_SIDE), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        )

    def in_view(self, places: np.ndarray) -> np.ndarray:
        """[N, 2] pixels of the view of places [N, 2] in the picture, 0 and POSE_SIDE at its edges."""
        return np.asarray(self.middle + self.scale * (places - POSE_SIDE / 2) @ self.axes.T)


class MediapipeHands:
    """A `HandLandmarker`: each view by itself."""

    def __init__(
        self, find_palms: Network, find_landmarks: Network, *, palm_score: float = 0.5, hand_score: float = 0.5
    ) -> None:
        """Take both networks; `load` reads them from files.

        Args:
            find_palms: outputs [1, ANCHORS, PALM_NUMBERS] and logits [1, ANCHORS, 1].
            find_landmarks: outputs landmarks [1, 63] in pixels of the picture, how likely it is a hand [1, 1] and in a
                mirrored picture a right one [1, 1], and landmarks [1, 63] in metres.
            palm_score: lowest score of a palm that is looked at, 0..1.
            hand_score: lowest score of a hand that is taken, 0..1.
        """
        self._find_palms = find_palms
        self._find_landmarks = find_landmarks
        self._palm_score = palm_score
        self._hand_score = hand_score
        self._anchors = palm_anchors()

    @classmethod
    def load(cls, folder: Path | str) -> "MediapipeHands":
        """Read both models from a folder; nothing is downloaded.

        Raises:
            LearnedModelError: a file is missing, damaged, or another model.
        """
        folder = Path(folder)
        palms = (1, ANCHORS, PALM_NUMBERS), (1, ANCHORS, 1)
        hands = (1, 3 * LANDMARKS), (1, 1), (1, 1), (1, 3 * LANDMARKS)
        find_palms = _read_network(folder / PALM_FILE, PALM_SIDE, palms)
        return cls(find_palms, _read_network(folder / POSE_FILE, POSE_SIDE, hands))

    def hands(self, view: View) -> list[HandLandmarks]:
        """The hands in a view, at most two, the most palm-like first."""
        found = (self._landmarks(view.image, picture) for picture in self._pictures(view.image))
        return [hand for hand in found if hand is not None]

    def _pictures(self, image: np.ndarray) -> list[HandPicture]:
        """Where the hands are, by their palms."""
        side = len(image)
        small = cv2.resize(image, (PALM_SIDE, PALM_SIDE), interpolation=cv2.INTER_AREA)
        numbers, logits = self._find_palms(_as_input(small))
        with np.errstate(over="ignore"):
            scores = 1 / (1 + np.exp(-logits[0, :, 0].astype(np.float64)))
        numbers = numbers[0].astype(np.float64)
        usable = (scores >= self._palm_score) & np.isfinite(numbers).all(axis=1) & (numbers[:, 2:4] > 0).all(axis=1)
        usable &= (numbers[:, 2:4] <= PALM_SIDE).all(axis=1)
        scores, numbers, anchors = scores[usable], numbers[usable], self._anchors[usable]
        sizes = numbers[:, 2:4] / PALM_SIDE * side
        # Places are measured from the edge of the view, pixels from the middle of the first one.
        middles = (numbers[:, :2] / PALM_SIDE + anchors) * side - 0.5
        places = (numbers[:, 4:].reshape(-1, 7, 2) / PALM_SIDE + anchors[:, None]) * side - 0.5
        boxes = np.column_stack([middles - sizes / 2, sizes])
        best = cv2.dnn.NMSBoxes(boxes.tolist(), scores.tolist(), self._palm_score, SAME_PALM)
        return [hand_picture(middles[each], sizes[each], places[each]) for each in best[:MOST_HANDS]]

    def _landmarks(self, image: np.ndarray, picture: HandPicture) -> HandLandmarks | None:
        pixels, score, right_in_mirror, metric = (
            output.astype(np.float64).ravel() for output in self._find_landmarks(_as_input(picture.cut(image)))
        )
        if not score[0] >= self._hand_score:
            return None
        metric = metric.reshape(LANDMARKS, 3)
        return HandLandmarks(
            pixels=picture.in_view(pixels.reshape(LANDMARKS, 3)[:, :2]),
            metric=np.column_stack([metric[:, :2] @ picture.axes.T, metric[:, 2]]),
            right=float(1 - right_in_mirror[0]),
            score=float(score[0]),
        )


def palm_anchors() -> np.ndarray:
    """[ANCHORS, 2] x, y in shares of the side: the middles of the cells of each grid, row by row."""
    anchors = []
    for cells, each in PALM_GRIDS:
        y, x = np.mgrid[:cells, :cells]
        anchors.append(np.repeat(np.column_stack([x.ravel(), y.ravel()]) + 0.5, each, axis=0) / cells)
    return np.vstack(anchors)


def hand_picture(middle: np.ndarray, size: np.ndarray, places: np.ndarray) -> HandPicture:
    """The picture of the hand of a palm: fingers up, a square around palm and fingers.

    Args:
        middle: [2] pixels, of the palm's box.
        size: [2] pixels, its width and height.
        places: [7, 2] pixels.
    """
    up = places[MIDDLE_KNUCKLE] - places[WRIST]
    length = float(np.linalg.norm(up))
    up = up / length if length > 0 else np.array([0.0, -1.0])
    return HandPicture(
        middle=middle + HAND_AHEAD * size[1] * up,
        axes=np.array([[-up[1], -up[0]], [up[0], -up[1]]]),
        scale=HAND_IN_PALMS * float(size.max()) / POSE_SIDE,
    )


def _as_input(picture: np.ndarray) -> np.ndarray:
    """[1, side, side, 3] float32 RGB from 0 to 1 of a picture [side, side, 3] uint8 BGR."""
    return np.ascontiguousarray(picture[None, ..., ::-1], dtype=np.float32) / 255


def _read_network(path: Path, side: int, shapes: tuple[tuple[int, ...], ...]) -> Network:
    """A network whose outputs have these shapes, in this order.

    Raises:
        LearnedModelError: there is no such file, or it holds another model or none.
    """
    require_file(path, f"the models {PALM_FILE} and {POSE_FILE}")
    with _silent():
        try:
            network = cv2.dnn.readNetFromONNX(str(path))
        except cv2.error as error:
            raise LearnedModelError(
                f"{path}: {path.stat().st_size} bytes that OpenCV cannot read as ONNX. Get the file itself (a clone "
                f"without Git LFS holds pointers of some 130 bytes); {PAGE} says where it comes from"
            ) from error
        names = network.getUnconnectedOutLayersNames()

        def run(picture: np.ndarray) -> Sequence[np.ndarray]:
            network.setInput(picture)
            outputs: Sequence[np.ndarray] = network.forward(names)
            return outputs

        try:
            found = tuple(output.shape for output in run(np.zeros((1, side, side, 3), np.float32)))
        except cv2.error as error:
            raise LearnedModelError(
                f"{path}: takes no pictures [1, {side}, {side}, 3]. Were the files mixed up? {PAGE} says which models "
                "are meant"
            ) from error
    if found != shapes:
        raise LearnedModelError(
            f"{path}: gives {_listed(found)}, needed are {_listed(shapes)}. Were the files mixed up? {PAGE} says which "
            "models are meant"
        )
    return run


def _listed(shapes: tuple[tuple[int, ...], ...]) -> str:
    return ", ".join(str(list(shape)) for shape in shapes)


@contextmanager
def _silent() -> Iterator[None]:
    """OpenCV logs what it raises, too."""
    before = cv2.setLogLevel(0)
    try:
        yield
    finally:
        cv2.setLogLevel(before)
