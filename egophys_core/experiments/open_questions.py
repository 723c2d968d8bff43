"""What a diagnosis left open, from the content of its `diagnosis.json`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from egophys_core.diagnosis.diagnosis import DetectionLimit
from egophys_core.diagnosis.saving import DIAGNOSIS_NAME
from egophys_core.errors import DiscrepancyError


def read_content(folder: Path) -> dict[str, Any]:
    """The content of the `diagnosis.json` in a folder.

    Raises:
        DiscrepancyError: there is none, or one of an earlier version.
    """
    path = folder / DIAGNOSIS_NAME
    try:
        content: dict[str, Any] = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DiscrepancyError(f"cannot read {path}: {error}; give the folder that `egophys diagnose` made") from error
    lacking = [name for name in ("limits", "ambiguous", "scale_m") if name not in content]
    if lacking:
        raise DiscrepancyError(f"{path}: it lacks `{lacking[0]}`, as one of an earlier version does; diagnose again")
    return content


def known_limits(content: Mapping[str, Any]) -> list[DetectionLimit]:
    """What its recordings could have shown."""
    return [DetectionLimit(**{**each, "alike": tuple(each["alike"])}) for each in content["limits"]]


def left_open(content: Mapping[str, Any]) -> list[str]:
    """The effects to ask about: those that it could not tell apart, else all that it does not name.

    What came nearest to being named is no guide: what the motions could not show comes last.
    """
    named = {each["name"] for each in content["effects"]}
    return list(content["ambiguous"]) or [each["name"] for each in content["candidates"] if each["name"] not in named]
