"""Framing of the xArm command port: a Modbus-TCP-like header around one-byte registers.

Request:  u16 transaction | u16 protocol | u16 length | u8 register | parameters
Reply:    u16 transaction | u16 protocol | u16 length | u8 register | u8 status | parameters
Header integers are big-endian; floats in parameters are little-endian float32.
"""

import enum
import struct
from collections.abc import Iterable
from dataclasses import dataclass

HEADER = struct.Struct(">HHH")

PRIVATE_PROTOCOLS = frozenset({2, 3})
"""3 differs from 2 only in that the client promises to be heard every 90 s."""

STANDARD_MODBUS = 0
HEARTBEAT = 1

LARGEST_BODY = 1024
"""The longest real request (DH parameters, trajectory names) is below 200 bytes."""


class ProtocolError(Exception):
    """The byte stream cannot be a request; where the next one starts is unknown from here on."""


class Status(enum.IntFlag):
    """The status byte of a reply; the client's return code is made from it."""

    OK = 0
    INVALID = 0x08
    NOT_READY = 0x10
    WARNING = 0x20
    ERROR = 0x40


@dataclass(frozen=True, kw_only=True, slots=True)
class Request:
    """One decoded request."""

    transaction: int
    protocol: int
    register: int
    params: bytes


class RequestReader:
    """Cuts a byte stream into requests, wherever the chunks of it happen to end."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Request]:
        """The requests that `data` completes, in order.

        Raises:
            ProtocolError: an unknown protocol number or an impossible length.
        """
        self._buffer += data
        requests = []
        while len(self._buffer) >= HEADER.size:
            transaction, protocol, length = HEADER.unpack_from(self._buffer)
            if protocol not in PRIVATE_PROTOCOLS and protocol not in (STANDARD_MODBUS, HEARTBEAT):
                raise ProtocolError(f"protocol number {protocol}, known are 0 to 3")
            if not 1 <= length <= LARGEST_BODY:
                raise ProtocolError(f"body of {length} bytes, must be 1 to {LARGEST_BODY}")
            end = HEADER.size + length
            if len(self._buffer) < end:
                break
            requests.append(
                Request(
                    transaction=transaction,
                    protocol=protocol,
                    register=self._buffer[HEADER.size],
                    params=bytes(self._buffer[HEADER.size + 1 : end]),
                )
            )
            del self._buffer[:end]
        return requests


def encode_reply(request: Request, status: Status, params: bytes = b"") -> bytes:
    """The reply to a request of the private protocol."""
    head = HEADER.pack(request.transaction, request.protocol, 2 + len(params))
    return head + bytes([request.register, status]) + params


def encode_modbus_reply(request: Request, pdu: bytes) -> bytes:
    """The reply to a request of standard Modbus TCP; its unit identifier stands where registers stand otherwise."""
    head = HEADER.pack(request.transaction, STANDARD_MODBUS, 1 + len(pdu))
    return head + bytes([request.register]) + pdu


def pack_floats(values: Iterable[float]) -> bytes:
    """Little-endian float32."""
    values = list(values)
    return struct.pack(f"<{len(values)}f", *values)


def unpack_floats(params: bytes, count: int) -> tuple[float, ...]:
    """The first `count` little-endian float32 of the parameters.

    Raises:
        ValueError: the parameters are too short.
    """
    if len(params) < 4 * count:
        raise ValueError(f"{len(params)} bytes of parameters, {4 * count} expected")
    return struct.unpack_from(f"<{count}f", params)
