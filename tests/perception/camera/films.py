"""Films to read: MP4s of OpenCV whose times and rotation are rewritten in the file, as phones write them."""

import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

_PARENTS = (b"moov", b"trak", b"mdia", b"minf", b"stbl")
_TURNS = {0: (1, 0, 0, 1), 90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}
"""a b c d of the matrix in `tkhd` (ISO/IEC 14496-12, 8.3.2) by the clockwise turn of the image."""


def write_film(
    path: Path,
    images: Sequence[np.ndarray],
    *,
    rate: float = 30.0,
    lasts: Sequence[int] | None = None,
    rotation_deg: int = 0,
) -> Path:
    """Write an MP4 of images [H, W, 3].

    Args:
        path: of the file.
        images: as the sensor has them.
        rate: frames a second.
        lasts: how long each frame is shown, in frames of that rate; None: 1 each.
        rotation_deg: clockwise, asked for by the file.
    """
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, (width, height))
    for image in images:
        writer.write(image)
    writer.release()
    path.write_bytes(_rewritten(path.read_bytes(), lasts, rotation_deg))
    return path


def _rewritten(data: bytes, lasts: Sequence[int] | None, rotation_deg: int) -> bytes:
    """Boxes with the times (`stts`) and the matrix (`tkhd`) replaced; the index stands behind the images."""
    out, at = b"", 0
    while at < len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if size == 0:
            size = len(data) - at
        body = data[at + 8 : at + size]
        if kind in _PARENTS:
            body = _rewritten(body, lasts, rotation_deg)
        elif kind == b"stts" and lasts is not None:
            step = struct.unpack_from(">I", body, 12)[0]
            body = body[:4] + struct.pack(">I", len(lasts))
            body += b"".join(struct.pack(">II", 1, step * each) for each in lasts)
        elif kind == b"tkhd":
            a, b, c, d = (each << 16 for each in _TURNS[rotation_deg])
            body = body[:40] + struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30) + body[76:]
        if kind == b"edts":
            body, kind = body, b"free"  # the edit list has the length of before
        out += struct.pack(">I4s", len(body) + 8, kind) + body
        at += size
    return out
