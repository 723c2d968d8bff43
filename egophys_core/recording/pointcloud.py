"""sensor_msgs/PointCloud2 <-> arrays of tracked points; one implementation for bags and for ROS nodes.

`points_of_message` takes any object with PointCloud2's attributes: a message of rclpy or one of rosbags.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from rosbags.serde import SerdeError

from egophys_core.episode import WORLD_FRAME
from egophys_core.errors import RecordingError
from egophys_core.recording.message_definitions import jazzy_types

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"

# sensor_msgs/PointField datatypes; the constants of the message are these numbers.
_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}

POINT_DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("id", "<u4"), ("confidence", "<f4")])
"""How this project writes a point: 20 bytes, little-endian, no padding."""

POINT_FIELDS: tuple[tuple[str, int, int], ...] = (
    ("x", 0, 7),
    ("y", 4, 7),
    ("z", 8, 7),
    ("id", 12, 6),
    ("confidence", 16, 7),
)
"""(name, offset, datatype) of the PointFields that describe `POINT_DTYPE`; every count is 1."""


CONTACT_FIELD = ("contact", POINT_DTYPE.itemsize, 2)
"""The PointField (uint8) that a controller point may have after those."""


class PointFieldLike(Protocol):
    """The attributes of a sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int


@dataclass(frozen=True, kw_only=True)
class PointFrame:
    """The points of one PointCloud2 message, as they are in it: not filtered, not sorted."""

    stamp_ns: int
    """Header stamp, nanoseconds since the epoch."""
    frame_id: str
    """Header frame."""
    ids: np.ndarray
    """[P] uint32."""
    xyz: np.ndarray
    """[P, 3] float32, metres in `frame_id`; may hold NaN."""
    confidence: np.ndarray
    """[P] float32; 1 where the message has no such field."""
    contact: np.ndarray | None = None
    """[P] of the field `contact` as it was sent; None where the message has no such field."""


def decode_points(cdr: bytes, *, source: str) -> PointFrame:
    """Read a serialized PointCloud2.

    Args:
        cdr: the message with its CDR encapsulation, either byte order.
        source: where it came from, for error messages.

    Raises:
        RecordingError: not a PointCloud2, or one `points_of_message` refuses.
    """
    try:
        message = jazzy_types().deserialize_cdr(cdr, POINTCLOUD2)
    except SerdeError as error:
        raise RecordingError(f"{source}: not a readable {POINTCLOUD2}: {error}") from error
    return points_of_message(message, source=source)


def points_of_message(message: Any, *, source: str) -> PointFrame:
    """Read the points of a PointCloud2 message object (rclpy's or rosbags').

    Field order, offsets, padding of points and rows, organised clouds and big-endian data are all taken;
    `x y z` may be float32 or float64, `id` any integer type.

    Args:
        message: the message.
        source: where it came from, for error messages.

    Raises:
        RecordingError: `x`, `y`, `z` or `id` is missing or of another kind (names the fields there are), an
            id is negative, or the declared sizes do not match the data.
    """
    table = _point_table(message, source)
    names = table.dtype.names or ()
    if "id" not in names:
        raise RecordingError(
            f"{source}: the point cloud has no field id; it has {', '.join(names) or 'no fields'}. "
            "Tracked points need x y z (float32, m) and id (uint32, stable)"
        )
    xyz = _xyz(table, source)
    if "confidence" in names and table.dtype["confidence"].kind != "f":
        raise RecordingError(f"{source}: field confidence must be float32, got {table.dtype['confidence'].name}")
    ids = table["id"]
    if ids.dtype.kind not in "iu":
        raise RecordingError(f"{source}: field id must be uint32, got {ids.dtype.name}")
    if ids.size and int(ids.min()) < 0:
        raise RecordingError(f"{source}: point ids must not be negative, got {int(ids.min())}")
    stamp = message.header.stamp
    return PointFrame(
        stamp_ns=int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec),
        frame_id=message.header.frame_id,
        ids=ids.astype(np.uint32),
        xyz=xyz,
        confidence=(
            table["confidence"].astype(np.float32) if "confidence" in names else np.ones(len(table), np.float32)
        ),
        contact=table["contact"].copy() if "contact" in names else None,
    )


def xyz_of_message(message: Any, *, source: str, frame: str = WORLD_FRAME) -> np.ndarray:
    """[P, 3] float32 metres: the positions in a PointCloud2 message object, whatever other fields it has.

    Args:
        message: as for `points_of_message`.
        source: where it came from, for error messages.
        frame: the frame the points must be in.

    Raises:
        RecordingError: another frame, `x`, `y` or `z` missing or of another kind, or sizes that do not match.
    """
    if message.header.frame_id != frame:
        raise RecordingError(f"{source}: the points are in frame {message.header.frame_id!r}, needed is {frame!r}")
    return _xyz(_point_table(message, source), source)


def _xyz(table: np.ndarray, source: str) -> np.ndarray:
    names = table.dtype.names or ()
    missing = [name for name in "xyz" if name not in names]
    if missing:
        raise RecordingError(
            f"{source}: the point cloud has no field {', '.join(missing)}; it has {', '.join(names) or 'no fields'}"
        )
    for name in "xyz":
        if table.dtype[name].kind != "f":
            raise RecordingError(f"{source}: field {name} must be float32, got {table.dtype[name].name}")
    return np.stack([table[name] for name in "xyz"], axis=1).astype(np.float32)


def pack_points(xyz: np.ndarray, ids: np.ndarray, confidence: np.ndarray, contact: np.ndarray | None = None) -> bytes:
    """Lay out points as the `data` of a PointCloud2 with `POINT_FIELDS` and `point_step` 20; with `contact` it is 21.

    Args:
        xyz: [P, 3], metres.
        ids: [P], 0 to 2^32 - 1.
        confidence: [P], 0 to 1.
        contact: [P] bool, which points hold the object; the field is left out without it.

    Raises:
        RecordingError: the shapes do not fit together.
    """
    columns = (ids, confidence) if contact is None else (ids, confidence, contact)
    if xyz.ndim != 2 or xyz.shape[1] != 3 or any(each.shape != xyz.shape[:1] for each in columns):
        raise RecordingError(
            f"points must be xyz [P, 3], ids [P], confidence [P], contact [P]; got {xyz.shape}, "
            f"{', '.join(str(each.shape) for each in columns)}"
        )
    table = np.empty(len(xyz), _dtype_of_points(with_contact=contact is not None))
    table["x"], table["y"], table["z"] = xyz.T
    table["id"] = ids
    table["confidence"] = confidence
    if contact is not None:
        table["contact"] = contact
    return table.tobytes()


def _dtype_of_points(*, with_contact: bool) -> np.dtype[np.void]:
    return np.dtype([*POINT_DTYPE.descr, ("contact", "u1")]) if with_contact else POINT_DTYPE


def encode_points(
    *,
    stamp_ns: int,
    frame_id: str,
    xyz: np.ndarray,
    ids: np.ndarray,
    confidence: np.ndarray,
    contact: np.ndarray | None = None,
) -> bytes:
    """Serialize points as a PointCloud2 in this project's layout (`POINT_FIELDS`, and `CONTACT_FIELD` with `contact`).

    Args:
        stamp_ns: header stamp, nanoseconds since the epoch.
        frame_id: header frame.
        xyz: [P, 3], metres.
        ids: [P], 0 to 2^32 - 1.
        confidence: [P], 0 to 1.
        contact: [P] bool, which points hold the object; the field is left out without it.

    Returns:
        The CDR bytes, with encapsulation.

    Raises:
        RecordingError: the shapes do not fit together.
    """
    data = pack_points(xyz, ids, confidence, contact)
    store = jazzy_types()
    types = store.types
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    message = types[POINTCLOUD2](
        header=types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds), frame_id=frame_id
        ),
        height=1,
        width=len(xyz),
        fields=[
            types["sensor_msgs/msg/PointField"](name=name, offset=offset, datatype=datatype, count=1)
            for name, offset, datatype in (*POINT_FIELDS, *(() if contact is None else (CONTACT_FIELD,)))
        ],
        is_bigendian=False,
        point_step=_dtype_of_points(with_contact=contact is not None).itemsize,
        row_step=len(data),
        data=np.frombuffer(data, np.uint8),
        is_dense=bool(np.isfinite(xyz).all()),
    )
    return bytes(store.serialize_cdr(message, POINTCLOUD2, little_endian=True))


def _point_table(message: Any, source: str) -> np.ndarray:
    """[P] structured array of the message's points."""
    width, height = int(message.width), int(message.height)
    point_step, row_step = int(message.point_step), int(message.row_step)
    data = np.frombuffer(message.data, np.uint8)
    if row_step < width * point_step or data.size != height * row_step:
        raise RecordingError(
            f"{source}: the point cloud declares {height} rows of {width} points of {point_step} bytes, "
            f"{row_step} bytes a row, but holds {data.size} bytes"
        )
    dtype = _point_dtype(message.fields, point_step, bool(message.is_bigendian), source)
    points = data.reshape(height, row_step)[:, : width * point_step]
    if points.size == 0:
        return np.empty(0, dtype)
    return np.ascontiguousarray(points).reshape(-1).view(dtype)


def _point_dtype(
    fields: Iterable[PointFieldLike], point_step: int, is_bigendian: bool, source: str
) -> np.dtype[np.void]:
    order = ">" if is_bigendian else "<"
    names, formats, offsets = [], [], []
    for field in fields:
        if field.count != 1 or field.name in names:
            continue  # an array or a repeated name: none of the fields read here
        if field.datatype not in _DATATYPES:
            raise RecordingError(f"{source}: field {field.name} has the unknown datatype {field.datatype}")
        dtype = np.dtype(order + _DATATYPES[field.datatype])
        if field.offset + dtype.itemsize > point_step:
            raise RecordingError(
                f"{source}: field {field.name} ends at byte {field.offset + dtype.itemsize} of a point of "
                f"{point_step} bytes"
            )
        names.append(field.name)
        formats.append(dtype)
        offsets.append(int(field.offset))
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": point_step})
