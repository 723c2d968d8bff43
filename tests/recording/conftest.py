"""Small bags to read, in every storage, and the real ones beside the repository where they are."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from egophys_core.recording import Record, encode_points, standard_definition

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"
SHARED_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


def make_records(frames: int = 6, points: int = 2) -> list[Record]:
    """Object and controller messages at 30 Hz, alternating, points moving along x."""
    records = []
    for frame in range(frames):
        stamp_ns = 1_000_000_000 + round(frame * 1e9 / 30)
        xyz = np.arange(points * 3, dtype=np.float32).reshape(points, 3) * 0.01 + frame * 0.001
        for topic, height in (("/object/points", 0.0), ("/controller/points", 0.5)):
            cdr = encode_points(
                stamp_ns=stamp_ns,
                frame_id="world",
                xyz=xyz + np.float32(height),
                ids=np.arange(points, dtype=np.uint32) * 3,
                confidence=np.full(points, 0.9, np.float32),
            )
            records.append(Record(topic=topic, type=POINTCLOUD2, log_time_ns=stamp_ns, cdr=cdr))
    return records


def write_mcap(
    path: Path,
    records: list[Record],
    *,
    compression: CompressionType = CompressionType.ZSTD,
    use_chunking: bool = True,
    enable_data_crcs: bool = False,
    per_chunk: int = 4,
) -> None:
    """Write records with the mcap library, `per_chunk` messages a chunk."""
    definition = standard_definition(POINTCLOUD2).text.encode()
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=use_chunking, enable_data_crcs=enable_data_crcs)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(POINTCLOUD2, "ros2msg", definition)
        channels = {
            topic: writer.register_channel(topic, "cdr", schema)
            for topic in dict.fromkeys(record.topic for record in records)
        }
        for index, record in enumerate(records):
            writer.add_message(channels[record.topic], record.log_time_ns, record.cdr, record.log_time_ns)
            if use_chunking and index % per_chunk == per_chunk - 1:
                writer.flush()
        writer.finish()


@pytest.fixture
def records() -> list[Record]:
    return make_records()


@pytest.fixture
def mcap_writer() -> Callable[..., None]:
    return write_mcap


@pytest.fixture
def shared_bags() -> list[Path]:
    bags = sorted(SHARED_DATA.glob("*/*/*.mcap"))
    if not bags:
        pytest.skip("the recorded episodes (../shared/data) are not on this machine")
    return bags
