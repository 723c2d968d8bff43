"""Tiny random networks as ONNX files, written field by field (onnx.proto of the ONNX project, IR version 8).

Each output is a random mixture of the mean red, green and blue of the picture, plus a bias.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

FLOAT, INT64 = 1, 7
INT_ATTRIBUTE, INTS_ATTRIBUTE = 2, 7


def write_network(path: Path, *, side: int, biases: Mapping[str, np.ndarray], random: float = 1e-3) -> Path:
    """Write a network that takes pictures [1, side, side, 3] and gives an output in the shape of each bias."""
    rng = np.random.default_rng(0)
    axes, flat = _ints("axes", (1, 2)), _field(1, "keepdims") + _field(3, 0) + _field(20, INT_ATTRIBUTE)
    nodes = [_node("ReduceMean", ["picture"], "colour", axes, flat)]
    arrays, outputs = b"", b""
    for name, bias in biases.items():
        mixture = rng.normal(0, random, (3, bias.size)).astype(np.float32)
        arrays += _field(5, _tensor(f"{name}.mixture", mixture))
        arrays += _field(5, _tensor(f"{name}.bias", bias.astype(np.float32).ravel()))
        arrays += _field(5, _tensor(f"{name}.shape", np.array(bias.shape, np.int64)))
        nodes.append(_node("Gemm", ["colour", f"{name}.mixture", f"{name}.bias"], f"{name}.flat"))
        nodes.append(_node("Reshape", [f"{name}.flat", f"{name}.shape"], name))
        outputs += _field(12, _value(name, bias.shape))
    inputs = _field(11, _value("picture", (1, side, side, 3)))
    graph = b"".join(_field(1, each) for each in nodes) + _field(2, "tiny") + arrays + inputs + outputs
    version = _field(8, _field(1, "") + _field(2, 13))
    path.write_bytes(_field(1, 8) + version + _field(7, graph))
    return path


def _node(kind: str, inputs: list[str], output: str, *attributes: bytes) -> bytes:
    named = b"".join(_field(1, each) for each in inputs) + _field(2, output) + _field(3, output)
    return named + _field(4, kind) + b"".join(_field(5, each) for each in attributes)


def _ints(name: str, values: tuple[int, ...]) -> bytes:
    return _field(1, name) + b"".join(_field(8, each) for each in values) + _field(20, INTS_ATTRIBUTE)


def _tensor(name: str, array: np.ndarray) -> bytes:
    kind = FLOAT if array.dtype == np.float32 else INT64
    return b"".join(_field(1, each) for each in array.shape) + _field(2, kind) + _field(8, name) + _field(9, array.data)


def _value(name: str, shape: tuple[int, ...]) -> bytes:
    sizes = b"".join(_field(1, _field(1, each)) for each in shape)
    return _field(1, name) + _field(2, _field(1, _field(1, FLOAT) + _field(2, sizes)))


def _field(number: int, value: int | str | bytes | memoryview) -> bytes:
    """One field of a protocol buffer: a number, or a text, message or array with its length."""
    if isinstance(value, int):
        return _varint(number << 3) + _varint(value)
    content = value.encode() if isinstance(value, str) else bytes(value)
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    found = bytearray()
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes([*found, value])
