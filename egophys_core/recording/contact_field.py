"""The field `contact` of recorded controller points: which of them hold the object, where that is known."""

from collections.abc import Sequence

import numpy as np

from egophys_core.errors import RecordingError
from egophys_core.recording.pointcloud import PointFrame


def recorded_contact(frames: Sequence[PointFrame], ids: np.ndarray, label: str) -> np.ndarray | None:
    """[T, C] bool: which controllers hold the object; None where no message has the field.

    In a frame that lacks a controller it does what it did in the last that has it, at the start in the first.

    Args:
        frames: one per time step.
        ids: [C] of the controllers, each in some frame.
        label: the episode's name and topic.

    Raises:
        RecordingError: some messages have the field and some do not, or it holds anything but 0 and 1.
    """
    without = [index for index, frame in enumerate(frames) if frame.contact is None]
    if len(without) == len(frames):
        return None
    if without:
        raise RecordingError(
            f"{label}: {len(without)} of {len(frames)} messages, the first in frame {without[0]}, have no field "
            "contact, the others do; record it in all of them or in none"
        )
    flags = np.full((len(frames), len(ids)), -1, np.int8)
    for index, frame in enumerate(frames):
        contact = _flags(frame, f"{label}: frame {index}")
        known = np.isin(frame.ids, ids)
        flags[index, np.searchsorted(ids, frame.ids[known])] = contact[known]
    return np.stack([_filled(column) for column in flags.T], axis=1) == 1


def _flags(frame: PointFrame, where: str) -> np.ndarray:
    """[P] uint8: the field of a message that has it."""
    contact = np.asarray(frame.contact)
    if contact.dtype != np.uint8:
        raise RecordingError(f"{where}: field contact must be uint8, got {contact.dtype.name}")
    if contact.size and contact.max() > 1:
        controller = frame.ids[contact.argmax()]
        raise RecordingError(
            f"{where}: contact of controller {controller} is {contact.max()}; it must be 1 (holds the object) or 0"
        )
    return contact


def _filled(flags: np.ndarray) -> np.ndarray:
    """[T] flags with those not known, -1, as the last known before them, or the first known."""
    known = np.flatnonzero(flags >= 0)
    last = np.searchsorted(known, np.arange(len(flags)), side="right") - 1
    return np.asarray(flags[known[np.maximum(last, 0)]])
