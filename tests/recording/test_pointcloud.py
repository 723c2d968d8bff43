"""PointCloud2 <-> arrays: round trips, foreign layouts, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from egophys_core.errors import RecordingError
from egophys_core.recording import (
    POINT_DTYPE,
    POINT_FIELDS,
    decode_points,
    encode_points,
    jazzy_types,
    pack_points,
    points_of_message,
)

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def cloud(table: np.ndarray, *, row_padding: int = 0, rows: int = 1, **changes):
    """A rosbags PointCloud2 message whose fields are those of a structured array."""
    types = jazzy_types().types
    width = len(table) // rows
    data = np.pad(table.view(np.uint8).reshape(rows, -1), ((0, 0), (0, row_padding))).reshape(-1)
    fields = [
        types["sensor_msgs/msg/PointField"](name=name, offset=offset, datatype=DATATYPES[dtype.str[1:]], count=1)
        for name, (dtype, offset) in table.dtype.fields.items()
    ]
    arguments = {
        "header": types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=12, nanosec=345), frame_id="world"
        ),
        "height": rows,
        "width": width,
        "fields": fields,
        "is_bigendian": any(dtype.str.startswith(">") for dtype, _ in table.dtype.fields.values()),
        "point_step": table.itemsize,
        "row_step": width * table.itemsize + row_padding,
        "data": data,
        "is_dense": True,
    }
    return types[POINTCLOUD2](**(arguments | changes))


def filled(dtype: np.dtype, count: int = 6) -> np.ndarray:
    table = np.zeros(count, dtype)
    for index, name in enumerate(table.dtype.names):
        table[name] = np.arange(count) + index if name != "confidence" else 0.5
    return table


@given(
    xyz=hnp.arrays(np.float32, st.tuples(st.integers(0, 20), st.just(3)), elements=st.floats(width=32)),
    stamp_ns=st.integers(0, 2**31 * 10**9 - 1),
    frame_id=st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=20),
    data=st.data(),
)
def test_encoded_points_decode_to_the_same_bits(xyz, stamp_ns, frame_id, data):
    ids = data.draw(hnp.arrays(np.uint32, len(xyz)))
    confidence = data.draw(hnp.arrays(np.float32, len(xyz), elements=st.floats(0, 1, width=32)))
    cdr = encode_points(stamp_ns=stamp_ns, frame_id=frame_id, xyz=xyz, ids=ids, confidence=confidence)
    frame = decode_points(cdr, source="test")
    assert (frame.stamp_ns, frame.frame_id) == (stamp_ns, frame_id)
    assert frame.xyz.tobytes() == xyz.tobytes()
    assert frame.xyz.shape == xyz.shape
    np.testing.assert_array_equal(frame.ids, ids)
    np.testing.assert_array_equal(frame.confidence, confidence)
    assert frame.ids.dtype == np.uint32


def test_layout_published_by_nodes_is_the_encoded_one():
    assert [(name, POINT_DTYPE.fields[name][1]) for name, _, _ in POINT_FIELDS] == [
        (name, offset) for name, offset, _ in POINT_FIELDS
    ]
    xyz, ids = np.arange(6, dtype=np.float32).reshape(2, 3), np.array([7, 9])
    data = pack_points(xyz, ids, np.ones(2))
    assert len(data) == 2 * POINT_DTYPE.itemsize
    assert data in encode_points(stamp_ns=0, frame_id="world", xyz=xyz, ids=ids, confidence=np.ones(2))


@given(
    order=st.permutations(["x", "y", "z", "id", "confidence", "rgb"]),
    endian=st.sampled_from("<>"),
    float_type=st.sampled_from(["f4", "f8"]),
    id_type=st.sampled_from(["u4", "i4", "u2"]),
    gap=st.integers(0, 7),
    row_padding=st.integers(0, 9),
    rows=st.sampled_from([1, 2, 3]),
)
def test_other_layouts_read_the_same(order, endian, float_type, id_type, gap, row_padding, rows):
    formats = [endian + {"id": id_type, "rgb": "u4"}.get(name, float_type) for name in order]
    sizes = np.array([np.dtype(text).itemsize for text in formats])
    offsets = (np.cumsum(sizes + gap) - sizes).tolist()
    dtype = np.dtype({"names": order, "formats": formats, "offsets": offsets, "itemsize": offsets[-1] + 8 + gap})
    table = filled(dtype)
    frame = points_of_message(cloud(table, row_padding=row_padding, rows=rows), source="test")
    np.testing.assert_array_equal(frame.xyz, np.stack([table["x"], table["y"], table["z"]], axis=1))
    np.testing.assert_array_equal(frame.ids, table["id"])
    np.testing.assert_array_equal(frame.confidence, table["confidence"])
    assert frame.stamp_ns == 12_000_000_345


def test_confidence_is_one_where_it_is_not_recorded():
    table = filled(np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("id", "<u4")]))
    np.testing.assert_array_equal(points_of_message(cloud(table), source="test").confidence, np.ones(6))


@pytest.mark.parametrize("missing", ["x", "y", "z", "id"])
def test_missing_field_is_named_with_those_there_are(missing):
    kept = [name for name in POINT_DTYPE.names if name != missing]
    table = filled(np.dtype([(name, POINT_DTYPE[name]) for name in kept]))
    with pytest.raises(RecordingError, match=f"no field {missing}; it has {', '.join(kept)}"):
        points_of_message(cloud(table), source="test")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"width": 7}, "declares 1 rows of 7 points of 20 bytes"),
        ({"height": 2}, "declares 2 rows"),
        ({"row_step": 119}, "119 bytes a row"),
        ({"data": np.zeros(119, np.uint8)}, "holds 119 bytes"),
        ({"point_step": 16}, "confidence ends at byte 20 of a point of 16 bytes"),
    ],
)
def test_sizes_that_do_not_fit_are_refused(changes, expected):
    with pytest.raises(RecordingError, match=expected):
        points_of_message(cloud(filled(POINT_DTYPE), **changes), source="test")


@pytest.mark.parametrize(
    ("name", "dtype", "expected"),
    [("x", "<i4", "x must be float32, got int32"), ("id", "<f4", "id must be uint32, got float32")],
)
def test_fields_of_another_kind_are_refused(name, dtype, expected):
    table = filled(np.dtype([(n, dtype if n == name else POINT_DTYPE[n]) for n in POINT_DTYPE.names]))
    with pytest.raises(RecordingError, match=expected):
        points_of_message(cloud(table), source="test")


def test_negative_id_is_refused():
    table = filled(np.dtype([(n, "<i4" if n == "id" else POINT_DTYPE[n]) for n in POINT_DTYPE.names]))
    table["id"][2] = -5
    with pytest.raises(RecordingError, match="must not be negative, got -5"):
        points_of_message(cloud(table), source="test")


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(RecordingError, match=r"got \(2, 3\), \(3,\), \(2,\)"):
        pack_points(np.zeros((2, 3)), np.zeros(3), np.zeros(2))


@given(st.binary(max_size=60))
def test_bytes_that_are_no_message_are_refused(noise):
    with pytest.raises(RecordingError, match="somewhere"):
        decode_points(noise, source="somewhere")


@given(st.data())
def test_damaged_message_is_refused_or_read_as_points(data):
    cdr = bytearray(
        encode_points(
            stamp_ns=1,
            frame_id="world",
            xyz=np.zeros((3, 3)),
            ids=np.arange(3),
            confidence=np.ones(3),
        )
    )
    at = data.draw(st.integers(0, len(cdr) - 1))
    cdr[at] = data.draw(st.integers(0, 255))
    cdr = cdr[: data.draw(st.integers(0, len(cdr)))]
    try:
        frame = decode_points(bytes(cdr), source="test")
    except RecordingError:
        return
    assert frame.xyz.shape == (len(frame.ids), 3)


def test_contact_is_one_more_byte_of_a_point():
    xyz, ids, flags = np.zeros((3, 3), np.float32), np.arange(3), np.array([True, False, True])
    frame = decode_points(
        encode_points(stamp_ns=0, frame_id="world", xyz=xyz, ids=ids, confidence=np.ones(3), contact=flags),
        source="test",
    )
    np.testing.assert_array_equal(frame.contact, flags.astype(np.uint8), strict=True)
    assert len(pack_points(xyz, ids, np.ones(3), flags)) == 3 * (POINT_DTYPE.itemsize + 1)
    with pytest.raises(RecordingError, match=r"got \(3, 3\), \(3,\), \(3,\), \(2,\)"):
        pack_points(xyz, ids, np.ones(3), flags[:2])
