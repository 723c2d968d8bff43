"""The tag board on the table: which print lies where in the world."""

from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from egophys_core.errors import OptionsError


class TagFamily(StrEnum):
    """AprilTag families that `cv2.aruco` has."""

    APRILTAG_16H5 = "16h5"
    APRILTAG_25H9 = "25h9"
    APRILTAG_36H10 = "36h10"
    APRILTAG_36H11 = "36h11"


_DICTIONARIES = {
    TagFamily.APRILTAG_16H5: cv2.aruco.DICT_APRILTAG_16h5,
    TagFamily.APRILTAG_25H9: cv2.aruco.DICT_APRILTAG_25h9,
    TagFamily.APRILTAG_36H10: cv2.aruco.DICT_APRILTAG_36h10,
    TagFamily.APRILTAG_36H11: cv2.aruco.DICT_APRILTAG_36h11,
}


@dataclass(frozen=True, kw_only=True)
class Board:
    """A grid of tags lying on the table, its x along world x and its y along world -y, so that it faces up.

    Board coordinates are metres from the outer corner of its first tag: x to the right, y down, as it is printed. The
    default is `cv2.aruco.GridBoard((4, 3), 0.06, 0.015)` with the world's x = 0 in its middle, 1 mm above the table
    and the side towards the user at y = 0.225 m, so that there is room for the object at the world's origin.
    """

    columns: int = 4
    rows: int = 3
    tag_side: float = 0.06
    """Metres, of the black square."""
    gap: float = 0.015
    """Metres, white between two tags."""
    first_id: int = 0
    """Id of the upper left tag; the others follow row by row."""
    family: TagFamily = TagFamily.APRILTAG_36H11
    origin: tuple[float, float, float] = (-0.1425, 0.435, 0.001)
    """World position of the outer corner of the first tag, metres; z is the height of the print above z = 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "family", TagFamily(self.family))
        if self.columns < 2 or self.rows < 2 or self.columns * self.rows < 6:
            raise OptionsError(
                f"a board needs at least 2 columns, 2 rows and 6 tags, got {self.columns} x {self.rows}: with fewer "
                "the direction of view is not certain"
            )
        if not (0.002 <= self.tag_side <= 2 and 0 < self.gap <= 2):
            raise OptionsError(
                f"tag side and gap must be metres in 0.002 .. 2, got {self.tag_side:g} and {self.gap:g}; 0.06 is 60 mm"
            )
        if len(self.origin) != 3 or not np.isfinite(self.origin).all():
            raise OptionsError(f"origin of the board must be three finite metres, got {self.origin}")
        last = self.first_id + self.columns * self.rows - 1
        available = len(self.dictionary.bytesList)
        if self.first_id < 0 or last >= available:
            raise OptionsError(f"board has tags {self.first_id} to {last}, {self.family} has 0 to {available - 1}")
        cell = self.tag_side / self.cells_per_tag
        if self.gap < cell * (1 - 1e-9):
            raise OptionsError(
                f"the gap of {self.gap:g} m is less than a cell of a tag, {cell:g} m; "
                "a tag is found by the white around it"
            )

    @property
    def dictionary(self) -> cv2.aruco.Dictionary:
        """OpenCV's dictionary of the family."""
        return cv2.aruco.getPredefinedDictionary(_DICTIONARIES[self.family])

    @property
    def size(self) -> tuple[float, float]:
        """Width and height from the first tag's outer corner to the last's, metres."""
        pitch = self.tag_side + self.gap
        return self.columns * pitch - self.gap, self.rows * pitch - self.gap

    @property
    def cells_per_tag(self) -> int:
        """Cells along a side of a tag, its black border of one cell included."""
        return int(self.dictionary.markerSize) + 2

    @property
    def tag_corners(self) -> np.ndarray:
        """[N, 2] float64, board coordinates, metres: upper left corner of each tag, in order of the ids."""
        pitch = self.tag_side + self.gap
        return np.array([(c * pitch, r * pitch) for r in range(self.rows) for c in range(self.columns)])

    def cells(self, tag: int) -> np.ndarray:
        """[M, M] bool: which cells of the tag-th tag (0 is the upper left) are white, its black border included."""
        cells = self.cells_per_tag
        return np.asarray(self.dictionary.generateImageMarker(self.first_id + tag, cells, None, 1)) > 127

    @property
    def world_from_board(self) -> np.ndarray:
        """[4, 4] float64: board coordinates (x, y, 0) to world; the board's z points into the table."""
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = self.origin
        return pose

    def corner_in_world(self, tag_id: int, corner: int) -> np.ndarray:
        """[3] float64, metres: a corner of a tag's black square, 0 to 3 clockwise from the upper left as printed.

        Raises:
            OptionsError: the board has no such tag, or a tag no such corner.
        """
        last = self.first_id + self.columns * self.rows - 1
        if not self.first_id <= tag_id <= last:
            raise OptionsError(f"the board has the tags {self.first_id} to {last}, not {tag_id}; see --board-columns")
        if not 0 <= corner <= 3:
            raise OptionsError(f"tag {tag_id} has the corners 0 to 3, clockwise from the upper left, not {corner}")
        beyond = self.tag_side * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])[corner]
        x, y = self.tag_corners[tag_id - self.first_id] + beyond
        return np.asarray((self.world_from_board @ (x, y, 0.0, 1.0))[:3])
