"""Writing an MP4 picture by picture; what is at the final path is whole."""

import os
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from egophys_core.errors import OutputError

CODEC = "mp4v"
"""MPEG-4 part 2: OpenCV's wheels encode it without further libraries."""

_VIEWS_FOR_THE_RATE = 12


class OverlayVideo:
    """An MP4 being written; pictures go to a hidden file beside it, which gets its name when all is well.

    Each picture lasts as long as the others: the median step of the first stamps. So a video with dropped views plays
    faster there. Used as a context manager; when the block fails nothing is left.
    """

    def __init__(self, path: Path) -> None:
        """Check that there is an encoder and that the folder can be written to.

        Raises:
            OutputError: it cannot.
        """
        self.path = path
        self.pictures = 0
        self._part = path.with_name(f".{path.name}.{os.getpid()}.part.mp4")
        self._writer: cv2.VideoWriter | None = None
        self._size: tuple[int, int] | None = None
        self._waiting: list[tuple[int, np.ndarray]] = []
        self._open((64, 64), 30.0).release()
        self._part.unlink(missing_ok=True)

    def write(self, stamp_ns: int, picture: np.ndarray) -> None:
        """Append a picture [H, W, 3] uint8 BGR, all of one size; a last odd row or column is cut by the encoder.

        Raises:
            OutputError: a picture of another size.
        """
        self.pictures += 1
        size = (picture.shape[1], picture.shape[0])
        self._size = self._size or size
        if size != self._size:
            raise OutputError(f"{self.path}: picture {self.pictures} is {size} pixels, those before {self._size}")
        if self._writer is not None:
            self._writer.write(picture)
            return
        self._waiting.append((stamp_ns, picture))
        if len(self._waiting) == _VIEWS_FOR_THE_RATE:
            self._writer = self._started(self._size)

    def close(self) -> None:
        """Finish the file and give it its name; without any picture there is none.

        Raises:
            OutputError: the file is not whole, as when the disk is full.
        """
        if self._size is None:
            return
        writer = self._writer or self._started(self._size)
        writer.release()
        # The encoder tells no errors: it writes the index last, so a file that opens with all pictures is whole.
        check = cv2.VideoCapture(str(self._part))
        written = int(check.get(cv2.CAP_PROP_FRAME_COUNT)) if check.isOpened() else 0
        check.release()
        if written != self.pictures:
            self._part.unlink(missing_ok=True)
            raise OutputError(f"cannot write {self.path}: {written} of {self.pictures} pictures arrived; free space?")
        with self._part.open("rb") as stream:
            os.fsync(stream.fileno())
        os.replace(self._part, self.path)

    def __enter__(self) -> Self:
        """Return the writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file, or remove it after an exception."""
        if kind is None:
            self.close()
            return
        if self._writer is not None:
            self._writer.release()
        self._part.unlink(missing_ok=True)

    def _started(self, size: tuple[int, int]) -> cv2.VideoWriter:
        """A writer at the rate of the waiting pictures, which are given to it."""
        steps = np.diff([stamp for stamp, _ in self._waiting])
        step_ns = float(np.median(steps)) if len(steps) else 0.0
        rate = float(np.clip(1e9 / step_ns, 1, 240)) if step_ns > 0 else 30.0
        # MPEG-4 part 2 counts time in 1/65535 of a second at most; two decimals fit.
        writer = self._open(size, round(rate, 2))
        for _, picture in self._waiting:
            writer.write(picture)
        self._waiting.clear()
        return writer

    def _open(self, size: tuple[int, int], rate: float) -> cv2.VideoWriter:
        if not os.access(self.path.parent, os.W_OK):
            raise OutputError(f"cannot write {self.path}: no folder {self.path.parent}, or no right to write there")
        writer = cv2.VideoWriter(str(self._part), cv2.VideoWriter.fourcc(*CODEC), rate, size)
        if not writer.isOpened():
            raise OutputError(
                f"cannot write {self.path}: OpenCV {cv2.__version__} has no {CODEC} encoder; install "
                "opencv-python-headless from PyPI, whose wheels bring one"
            )
        return writer
