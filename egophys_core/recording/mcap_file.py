"""Reading one MCAP file front to back, so that a file without footer, cut or damaged, gives what it holds.

The framing (opcode, length, payload) is walked here rather than by `mcap.StreamReader` because the byte
offset of damage and the readable beginning of a cut chunk are wanted, and a damaged length must not be
allocated.
Format: https://mcap.dev/spec, whose data section is Schema, Channel, Message, Chunk, MessageIndex, Attachment
and Metadata records up to DataEnd. Any other opcode there is taken for damage: skipping it, as the format
allows for private records, could hide a lost chunk.
"""

import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, TypeVar

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, McapRecord, Metadata, Schema

from egophys_core.errors import RecordingError
from egophys_core.recording.records import NO_FOOTER, DamagedFileError, Record, TopicTable

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_MESSAGE_INDEX_HEAD = struct.Struct("<HI")

_ParsedRecord = TypeVar("_ParsedRecord", bound=McapRecord)


def read_mcap(path: Path, topics: TopicTable, wanted: Collection[str] | None) -> Iterator[Record]:
    """Yield the records of one MCAP file in file order.

    Args:
        path: the file; it starts with the MCAP magic.
        topics: filled with the topics met and their counts, wanted or not.
        wanted: topics to yield; None yields all.

    Raises:
        DamagedFileError: the file is cut or damaged; every record before the damage has been yielded.
        RecordingError: a wanted topic is not CDR.
    """
    size = path.stat().st_size
    section = _DataSection(path, topics, wanted)
    with path.open("rb") as stream:
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            raise DamagedFileError(path, len(magic), "cut inside the first eight bytes")
        checksum = zlib.crc32(magic)
        is_first = True
        while True:
            offset = stream.tell()
            head = stream.read(RECORD_HEAD.size)
            if len(head) < RECORD_HEAD.size:
                raise DamagedFileError(path, size, NO_FOOTER)
            opcode, length = RECORD_HEAD.unpack(head)
            if is_first != (opcode == Opcode.HEADER):
                raise DamagedFileError(path, offset, f"unexpected record 0x{opcode:02x}")
            payload = stream.read(min(length, size - stream.tell()))
            if opcode == Opcode.DATA_END and length == len(payload) == 4:
                _check_end(path, stream, offset, payload, checksum)
                return
            yield from section.records(offset, opcode, length, payload)
            checksum = zlib.crc32(payload, zlib.crc32(head, checksum))
            is_first = False


class _DataSection:
    """Turns the records of an MCAP data section into `Record`s; holds its schemas and channels."""

    def __init__(self, path: Path, topics: TopicTable, wanted: Collection[str] | None) -> None:
        self._path = path
        self._topics = topics
        self._wanted = wanted
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}

    def records(self, offset: int, opcode: int, length: int, payload: bytes) -> Iterator[Record]:
        """Yield the messages in the record at byte `offset`; its `payload` is short of `length` if cut."""
        if opcode == Opcode.CHUNK:
            yield from self._chunk(offset, length, payload)
        elif len(payload) < length:
            raise self._cut(offset, payload)
        elif opcode == Opcode.MESSAGE_INDEX:
            if length < 6 or _MESSAGE_INDEX_HEAD.unpack_from(payload)[1] != length - 6:
                raise DamagedFileError(self._path, offset, "damaged message index")
        elif opcode == Opcode.ATTACHMENT:
            self._parse(offset, payload, Attachment.read)
        elif opcode == Opcode.METADATA:
            self._parse(offset, payload, Metadata.read)
        elif opcode == Opcode.HEADER:
            self._parse(offset, payload, Header.read)
        else:
            yield from self._content(offset, opcode, payload)

    def _chunk(self, offset: int, length: int, payload: bytes) -> Iterator[Record]:
        if len(payload) < _CHUNK_HEAD.size:
            raise self._cut(offset, payload)
        *_, uncompressed_size, checksum, name_size = _CHUNK_HEAD.unpack_from(payload)
        data_at = _CHUNK_HEAD.size + name_size + 8
        if length < data_at:
            raise DamagedFileError(self._path, offset, "damaged chunk head")
        if len(payload) < data_at:
            raise self._cut(offset, payload)
        compression = payload[_CHUNK_HEAD.size : data_at - 8]
        if data_at + int.from_bytes(payload[data_at - 8 : data_at], "little") != length:
            raise DamagedFileError(self._path, offset, "damaged chunk head")

        data, problem = _decompress(compression, payload[data_at:])
        is_cut = len(payload) < length
        if not is_cut:
            if problem is None and len(data) != uncompressed_size:
                problem = f"{len(data)} bytes unpacked, {uncompressed_size} expected"
            if problem is None and checksum != 0 and zlib.crc32(data) != checksum:
                problem = "checksum does not match"
            if problem is not None:
                raise DamagedFileError(self._path, offset, f"damaged chunk: {problem}")
        yield from self._chunk_content(offset, data, is_cut)
        if is_cut:
            raise self._cut(offset, payload)

    def _chunk_content(self, offset: int, data: bytes, is_cut: bool) -> Iterator[Record]:
        at = 0
        while at < len(data):
            body_at = at + RECORD_HEAD.size
            opcode, length = RECORD_HEAD.unpack_from(data, at) if body_at <= len(data) else (0, len(data))
            if body_at + length > len(data):
                if is_cut:
                    return
                raise DamagedFileError(self._path, offset, "a record crosses the end of its chunk")
            yield from self._content(offset, opcode, data[body_at : body_at + length])
            at = body_at + length

    def _content(self, offset: int, opcode: int, payload: bytes) -> Iterator[Record]:
        """Handle a Schema, Channel or Message, which may stand in a chunk or by itself."""
        if opcode == Opcode.MESSAGE:
            if len(payload) < _MESSAGE_HEAD.size:
                raise DamagedFileError(self._path, offset, "damaged message")
            channel_id, _, log_time, _ = _MESSAGE_HEAD.unpack_from(payload)
            channel = self._channels.get(channel_id)
            if channel is None:
                raise DamagedFileError(self._path, offset, f"a message of channel {channel_id}, which is not declared")
            self._topics.count(channel.topic)
            if self._wanted is None or channel.topic in self._wanted:
                if channel.message_encoding != "cdr":
                    raise RecordingError(
                        f"{self._path}: {channel.topic} is encoded as {channel.message_encoding!r}; only "
                        "ROS 2 bags (cdr) are read, convert it first"
                    )
                yield Record(
                    topic=channel.topic,
                    type=self._type_of(channel),
                    log_time_ns=log_time,
                    cdr=payload[_MESSAGE_HEAD.size :],
                )
        elif opcode == Opcode.SCHEMA:
            schema = self._parse(offset, payload, Schema.read)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = self._parse(offset, payload, Channel.read)
            self._channels[channel.id] = channel
            described = self._schemas.get(channel.schema_id)
            definition = described.data.decode(errors="replace") if described else ""
            self._topics.declare(channel.topic, self._type_of(channel), definition)
        else:
            raise DamagedFileError(self._path, offset, f"unexpected record 0x{opcode:02x}")

    def _type_of(self, channel: Channel) -> str:
        schema = self._schemas.get(channel.schema_id)
        return schema.name if schema else ""

    def _cut(self, offset: int, payload: bytes) -> DamagedFileError:
        return DamagedFileError(self._path, offset + RECORD_HEAD.size + len(payload), "cut inside a record")

    def _parse(self, offset: int, payload: bytes, read: Callable[[ReadDataStream], _ParsedRecord]) -> _ParsedRecord:
        stream = ReadDataStream(BytesIO(payload))
        try:
            record = read(stream)
        except (McapError, struct.error, UnicodeDecodeError) as error:
            raise DamagedFileError(self._path, offset, f"damaged {read.__qualname__.split('.')[0]} record") from error
        if stream.count != len(payload):
            raise DamagedFileError(self._path, offset, f"damaged {type(record).__name__} record")
        return record


def _decompress(compression: bytes, data: bytes) -> tuple[bytes, str | None]:
    """Unpack as much as `data` holds, never trusting a declared size; returns it and what went wrong."""
    try:
        if compression == b"zstd":
            return zstandard.ZstdDecompressor().decompressobj().decompress(data), None
        if compression == b"lz4":
            return lz4.frame.LZ4FrameDecompressor().decompress(data), None
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        return b"", str(error)
    if compression:
        return b"", f"compression {compression!r} is not known"
    return data, None


def _check_end(path: Path, stream: BinaryIO, offset: int, payload: bytes, checksum: int) -> None:
    """Check what closes a data section: its own checksum if it has one, and the magic at the end of the file.

    Raises:
        DamagedFileError: the footer is cut (all messages were read) or a byte somewhere before has changed.
    """
    recorded = int.from_bytes(payload, "little")
    if recorded not in (0, checksum):
        raise DamagedFileError(path, offset, "checksum of the data section does not match")
    data_end = stream.tell()
    end = stream.seek(0, 2)
    stream.seek(max(data_end, end - len(MAGIC)))
    if stream.read() != MAGIC:
        raise DamagedFileError(path, end, "the summary at the end is cut or damaged")
