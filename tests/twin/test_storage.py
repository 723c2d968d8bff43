"""A twin's file: it comes back as it was, and nothing else is taken for one."""

import dataclasses
import hashlib
import io
import json
import os

import numpy as np
import pytest

from egophys_core.errors import TwinError
from egophys_core.twin import decode_twin, encode_twin, load_twin, save_twin
from egophys_core.twin.storage import FORMAT_VERSION
from tests.simulation.scenes import sheet_model
from tests.twin.examples import make_twin


def rewritten(content: bytes, **changes) -> bytes:
    """A twin file with some arrays replaced, or dropped where None is given."""
    with np.load(io.BytesIO(content)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays.update(changes)
    stream = io.BytesIO()
    np.savez(stream, **{name: array for name, array in arrays.items() if array is not None})
    return stream.getvalue()


def header_of(content: bytes) -> dict:
    with np.load(io.BytesIO(content)) as archive:
        return json.loads(archive["header"].tobytes())


def with_header(content: bytes, header: dict) -> bytes:
    return rewritten(content, header=np.frombuffer(json.dumps(header).encode(), np.uint8))


def test_twin_comes_back_as_it_was(tmp_path):
    twin, path = make_twin(), tmp_path / "towel.twin"
    save_twin(twin, path)
    loaded = load_twin(path)
    assert path.read_bytes() == encode_twin(twin) == encode_twin(loaded)
    assert loaded.twin_id == twin.twin_id
    for name, array in twin.arrays().items():
        assert np.array_equal(loaded.arrays()[name], array), name
        assert loaded.arrays()[name].dtype == array.dtype, name
    assert loaded.model.parameters == twin.model.parameters
    assert loaded.model.kind == twin.model.kind
    assert loaded.provenance.episodes == twin.provenance.episodes
    assert loaded.provenance.seed == 2**40
    assert loaded.ground_height == -0.003


def test_a_rod_comes_back_as_uneven_as_it_was():
    twin = make_twin()
    uneven = np.random.default_rng(1).normal(size=(len(twin.model.graph.positions), 2)).astype(np.float32)
    bent = dataclasses.replace(twin, model=dataclasses.replace(twin.model, intrinsic_curvature=uneven))
    assert np.array_equal(decode_twin(encode_twin(bent), name="it").model.intrinsic_curvature, uneven)
    assert bent.twin_id != twin.twin_id
    with pytest.raises(TwinError, match="finite numbers in 1/m"):
        dataclasses.replace(twin.model, intrinsic_curvature=uneven[1:])


def test_saving_again_replaces_the_file(tmp_path):
    path = tmp_path / "towel.twin"
    save_twin(make_twin(), path)
    other = make_twin(ground_height=0.5)
    save_twin(other, path)
    assert load_twin(path).twin_id == other.twin_id
    assert os.listdir(tmp_path) == ["towel.twin"]


def test_twin_id_changes_with_every_array():
    twin = make_twin()
    ids = {twin.twin_id}
    for name, array in twin.arrays().items():
        changed = array.copy()
        if name == "springs":
            changed[:2] = changed[1::-1]
        elif name == "grasp":
            changed = changed[:1]
        else:
            changed.flat[0] = not changed.flat[0] if array.dtype == bool else changed.flat[0] + changed.dtype.type(1)
        if name == "grasp":
            other = dataclasses.replace(twin, grasp=changed)
        elif name == "stiffness":
            other = dataclasses.replace(twin, model=dataclasses.replace(twin.model, stiffness=changed))
        else:
            graph = dataclasses.replace(twin.model.graph, **{name: changed})
            other = dataclasses.replace(twin, model=dataclasses.replace(twin.model, graph=graph))
        ids.add(other.twin_id)
    assert len(ids) == 1 + len(twin.arrays())


def test_twin_id_changes_with_parameters_and_provenance():
    twin = make_twin()
    model = dataclasses.replace(
        twin.model, parameters=dataclasses.replace(twin.model.parameters, friction=np.nextafter(0.4, 1))
    )
    assert dataclasses.replace(twin, model=model).twin_id != twin.twin_id
    provenance = dataclasses.replace(twin.provenance, seed=1)
    assert dataclasses.replace(twin, provenance=provenance).twin_id != twin.twin_id
    assert make_twin().twin_id == twin.twin_id


@pytest.mark.parametrize("share", [0.0, 0.001, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.999])
def test_cut_file_is_refused_with_its_name(tmp_path, share):
    content = encode_twin(make_twin())
    path = tmp_path / "cut.twin"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(TwinError, match=r"cut\.twin"):
        load_twin(path)


def test_file_cut_at_any_offset_is_refused():
    content = encode_twin(make_twin())
    generator = np.random.default_rng(0)
    for length in [*generator.integers(0, len(content), 200).tolist(), len(content) - 1]:
        with pytest.raises(TwinError):
            decode_twin(content[:length], name="cut")


def test_damaged_bytes_are_noticed_or_harmless():
    # Array data are under a checksum; a flipped bit elsewhere may only change what is not read.
    twin = make_twin()
    content = encode_twin(twin)
    generator = np.random.default_rng(1)
    refused = 0
    for offset in generator.integers(0, len(content), 300).tolist():
        damaged = bytearray(content)
        damaged[offset] ^= 1 << int(generator.integers(8))
        try:
            assert decode_twin(bytes(damaged), name="damaged").twin_id == twin.twin_id, f"byte {offset}"
        except TwinError:
            refused += 1
    assert refused > 150


@pytest.mark.parametrize("content", [b"", b"not a twin", b"PK\x05\x06" + bytes(18), b"\x93NUMPY"])
def test_other_files_are_refused(content):
    with pytest.raises(TwinError, match=r"it\.twin is not a twin file, or it is cut .*build it again"):
        decode_twin(content, name="it.twin")


@pytest.mark.parametrize("version", [FORMAT_VERSION + 1, 0, None, "1"])
def test_other_format_version_is_refused(version):
    content = encode_twin(make_twin())
    header = {**header_of(content), "format_version": version}
    what = "update egophys" if version == FORMAT_VERSION + 1 else "build it again"
    with pytest.raises(TwinError, match=f"old.twin has twin format {version}, .* up to {FORMAT_VERSION}; {what}"):
        decode_twin(with_header(content, header), name="old.twin")


@pytest.mark.parametrize("name", ["positions", "springs", "kinds", "rest_lengths", "surface", "stiffness", "grasp"])
def test_missing_array_is_refused(name):
    with pytest.raises(TwinError, match="lacks or has unknown twin fields"):
        decode_twin(rewritten(encode_twin(make_twin()), **{name: None}), name="it")


@pytest.mark.parametrize(
    "changes",
    [
        {"parameters": [1]},
        {"effects": [{"name": "quadratic_drag", "values": [1]}]},
        {"effects": [{"name": "quadratic_drag", "values": {"coefficient": 10**400}}]},
        {"effects": [{"name": "quadratic_drag", "values": {"coefficient": "5"}}]},
        {"ground_height": "zero"},
        {"ground_height": 10**400},
    ],
)
def test_header_field_of_another_type_is_refused(changes):
    content = encode_twin(make_twin())
    with pytest.raises(TwinError, match=r"it\b.*build it again"):
        decode_twin(with_header(content, {**header_of(content), **changes}), name="it")


def test_a_damaged_compressed_twin_is_refused():
    stream = io.BytesIO()
    with np.load(io.BytesIO(encode_twin(make_twin()))) as archive:
        np.savez_compressed(stream, **archive)
    content = stream.getvalue()
    assert decode_twin(content, name="it").twin_id == make_twin().twin_id
    # The first byte of the compressed data, after a name of 30 bytes and the zip's own header of that array.
    damaged = bytearray(content)
    start = 30 + int.from_bytes(content[26:28], "little") + int.from_bytes(content[28:30], "little")
    damaged[start] = 0xFF
    with pytest.raises(TwinError, match="it is not a twin file"):
        decode_twin(bytes(damaged), name="it")


@pytest.mark.parametrize("name", ["kind", "parameters", "ground_height", "provenance"])
def test_missing_header_field_is_refused(name):
    content = encode_twin(make_twin())
    header = header_of(content)
    del header[name]
    with pytest.raises(TwinError, match="lacks or has unknown twin fields"):
        decode_twin(with_header(content, header), name="it")


@pytest.mark.parametrize("header", [[], 1, "text", None])
def test_header_that_is_no_object_is_refused(header):
    with pytest.raises(TwinError):
        decode_twin(with_header(encode_twin(make_twin()), header), name="it")


def test_unknown_parameter_is_refused():
    content = encode_twin(make_twin())
    header = header_of(content)
    warmer = {**header, "parameters": {**header["parameters"], "warmth": 1.0}}
    with pytest.raises(TwinError, match="unknown twin fields"):
        decode_twin(with_header(content, warmer), name="it")


def test_a_twin_from_before_springs_gave_way_when_pressed_is_read():
    content = encode_twin(make_twin())
    header = header_of(content)
    del header["parameters"]["compression_ratio"]
    assert decode_twin(with_header(content, header), name="it").model.parameters.compression_ratio == 1.0


def test_a_twin_with_the_former_names_of_its_intrinsic_curvature_is_read():
    content = encode_twin(make_twin())
    header = header_of(content)
    for name in ("intrinsic_curvature_level", "intrinsic_curvature_up"):
        del header["parameters"][name]
    header["parameters"].update(natural_bend_level=1.5, natural_bend_up=-0.25)
    read = decode_twin(with_header(content, header), name="it").model.parameters
    assert (read.intrinsic_curvature_level, read.intrinsic_curvature_up) == (1.5, -0.25)


def test_a_twin_keeps_the_id_by_which_earlier_logs_name_it():
    """The id is of the header as it was when intrinsic curvature was called natural bend, and nothing carried air."""
    twin = make_twin()
    header = twin.header()
    parameters = header["parameters"]
    parameters["natural_bend_level"] = parameters.pop("intrinsic_curvature_level")
    parameters["natural_bend_up"] = parameters.pop("intrinsic_curvature_up")
    # They came later.
    del parameters["added_mass"], parameters["far_roll"]
    content = b"".join(np.ascontiguousarray(array).tobytes() for array in twin.arrays().values())
    former = hashlib.sha256(content + json.dumps(header, sort_keys=True).encode()).hexdigest()
    assert twin.twin_id == former[:16]


def test_arrays_that_do_not_fit_together_are_refused():
    content = encode_twin(make_twin())
    with pytest.raises(TwinError, match=r"^it: spring graph: surface must be .*; build it again"):
        decode_twin(rewritten(content, surface=np.ones(3, bool)), name="it")
    springs = make_twin().model.graph.springs.copy()
    springs[0, 1] = 99
    with pytest.raises(TwinError, match=r"^it: .*names node 99"):
        decode_twin(rewritten(content, springs=springs), name="it")


def test_file_has_no_pickled_array():
    with np.load(io.BytesIO(encode_twin(make_twin())), allow_pickle=False) as archive:
        assert all(archive[name].dtype != object for name in archive.files)


def test_pickled_content_is_never_executed(tmp_path):
    class Trap:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "executed"),))

    stream = io.BytesIO()
    np.savez(stream, header=np.array([Trap()], dtype=object))
    with pytest.raises(TwinError, match="trap is not a twin file"):
        decode_twin(stream.getvalue(), name="trap")
    assert not (tmp_path / "executed").exists()


def test_crash_while_saving_leaves_the_old_twin_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "towel.twin"
    save_twin(make_twin(), path)
    before = path.read_bytes()

    def crash(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", crash)
    with pytest.raises(KeyboardInterrupt):
        save_twin(make_twin(model=sheet_model(stiffness=99.0)), path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["towel.twin"]


def test_full_disk_is_an_error_of_the_twin(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(TwinError, match=r"cannot write twin .*towel\.twin: No space left on device"):
        save_twin(make_twin(), tmp_path / "towel.twin")
    assert os.listdir(tmp_path) == []


def test_missing_folder_and_missing_file_are_named(tmp_path):
    with pytest.raises(TwinError, match=r"cannot write twin .*nowhere/towel\.twin: No such file .*folder exists"):
        save_twin(make_twin(), tmp_path / "nowhere" / "towel.twin")
    with pytest.raises(TwinError, match=r"cannot read twin .*towel\.twin: No such file"):
        load_twin(tmp_path / "towel.twin")
    with pytest.raises(TwinError, match="Is a directory"):
        load_twin(tmp_path)
