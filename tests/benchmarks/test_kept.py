"""Result files fill up row by row."""

import json
import math
from pathlib import Path

from benchmarks.kept import fill, kept_in


def test_only_what_has_no_row_is_measured_and_all_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "roots.json"
    kept = kept_in(path, {"roots": {"four": "as it was"}, "machine": "this one"})
    fill(path, kept, kept["roots"], math.sqrt, {"four": 4.0, "nine": 9.0})
    assert json.loads(path.read_text()) == {"roots": {"four": "as it was", "nine": 3.0}, "machine": "this one"}
    assert kept_in(path, {}) == kept


def test_nothing_is_measured_or_written_where_no_row_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "roots.json"
    fill(path, {}, {"one": 1.0}, math.sqrt, {"one": -1.0})
    assert not path.exists()
