"""Atomic writing: the old file or the new one, and nothing besides."""

import os
import signal
import subprocess
import sys
import time

import pytest

from egophys_core.errors import OutputError
from egophys_core.files import FileKind, hidden_folder, new_folder, require_writable, write_atomically, write_json


def test_content_is_written_and_replaced(tmp_path):
    path = tmp_path / "it"
    write_atomically(path, b"one")
    write_atomically(path, b"two")
    assert path.read_bytes() == b"two"
    assert os.listdir(tmp_path) == ["it"]


def test_json_is_written_whole_or_not_at_all(tmp_path):
    write_json(tmp_path / "it", {"a": [1, 2.5]})
    with pytest.raises(TypeError):
        write_json(tmp_path / "it", {"a": object()})
    assert (tmp_path / "it").read_bytes() == b'{\n "a": [\n  1,\n  2.5\n ]\n}\n'
    assert os.listdir(tmp_path) == ["it"]


def test_others_may_read_the_file(tmp_path):
    write_atomically(tmp_path / "it", b"one")
    assert (tmp_path / "it").stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize("step", ["replace", "fsync", "chmod"])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_failure_at_any_step_leaves_the_old_file_and_no_other(tmp_path, monkeypatch, step, error):
    path = tmp_path / "it"
    write_atomically(path, b"old")

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(type(error)):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["it"]


def test_hidden_names_fit_where_the_final_ones_do(tmp_path):
    longest = tmp_path / ("é" * 127)
    write_atomically(longest, b"one")
    folder = hidden_folder(longest)
    assert folder.parent == tmp_path
    longest.unlink()
    folder.rename(longest)


def test_a_new_folder_is_there_whole_or_not_at_all(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    with new_folder(out) as making:
        (making / "it").write_text("one")
        assert not list(out.iterdir())
    assert (out / "it").read_text() == "one"

    def fail(error):
        with new_folder(tmp_path / "other") as making:
            (making / "it").write_text("half")
            raise error

    with pytest.raises(OutputError, match="No space left"):
        fail(OSError(28, "No space left on device"))
    with pytest.raises(KeyboardInterrupt):
        fail(KeyboardInterrupt())
    assert [each.name for each in tmp_path.iterdir()] == ["out"]


def test_missing_folder_is_an_oserror(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_atomically(tmp_path / "nowhere" / "it", b"one")


def test_place_for_a_result_is_checked_before_the_work(tmp_path):
    kind = FileKind(name="a list", head=rb"\[")
    require_writable(tmp_path / "it", kind)
    write_atomically(tmp_path / "it", b"[1]")
    require_writable(tmp_path / "it", kind)
    with pytest.raises(OutputError, match=r"folder .*nowhere does not exist; create it first"):
        require_writable(tmp_path / "nowhere" / "it", kind)
    with pytest.raises(OutputError, match="it is a folder; give a file name"):
        require_writable(tmp_path, kind)


def test_result_replaces_neither_what_it_is_made_from_nor_another_kind_of_file(tmp_path):
    kind = FileKind(name="a list", head=rb"\[")
    path, folder = tmp_path / "it", tmp_path / "read"
    folder.mkdir()
    (tmp_path / "link").symlink_to(folder)
    for inside in (folder / "it", tmp_path / "link" / "it", tmp_path / "read" / ".." / "read" / "it"):
        with pytest.raises(OutputError, match=r"is in .*read, which is read by the same command; choose a place out"):
            require_writable(inside, kind, inputs=[folder])
    with pytest.raises(OutputError, match="it is read by the same command; choose another name"):
        require_writable(path, kind, inputs=[folder, tmp_path / "read" / ".." / "it"])
    for content in (b"", b"[1]"):
        path.write_bytes(content)
        require_writable(path, kind, inputs=[folder])
    path.write_bytes(b"notes")
    with pytest.raises(OutputError, match="it is there already and is not a list; choose another name or move it aw"):
        require_writable(path, kind)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="is not a list"):
        require_writable(tmp_path / "pipe", kind)


def test_killed_writer_leaves_a_whole_file(tmp_path):
    # A process that rewrites the file over and over is killed in the middle of it, several times.
    path = tmp_path / "it"
    old, new = b"a" * 300_000, b"b" * 300_000
    write_atomically(path, old)
    program = (
        "import sys; from pathlib import Path; from egophys_core.files import write_atomically; print(flush=True)\n"
        "while True:\n"
        f"    for letter in b'ab': write_atomically(Path({str(path)!r}), bytes([letter]) * 300_000)\n"
    )
    for delay in (0.005, 0.02, 0.05):
        with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as writer:
            writer.stdout.readline()
            time.sleep(delay)
            writer.send_signal(signal.SIGKILL)
        assert path.read_bytes() in (old, new)
