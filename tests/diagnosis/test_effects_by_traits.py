"""Diagnosis learns of an effect through its traits alone."""

import re
from pathlib import Path

import egophys_core.diagnosis
from egophys_core.effects import LIBRARY

ROOM = Path(egophys_core.diagnosis.__file__).parent


def test_no_effect_is_known_by_name():
    names = re.compile(rf"\b({'|'.join(LIBRARY)})\b")
    found = {
        f"{path.relative_to(ROOM)}: {match.group()}"
        for path in ROOM.rglob("*.py")
        for match in names.finditer(path.read_text())
    }
    assert not found
