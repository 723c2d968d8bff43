"""Stamps of a topic's messages: steady enough to be one recording, or one error before any work."""

from collections.abc import Sequence

import numpy as np

from egophys_core.episode import LONGEST_GAP_S
from egophys_core.errors import EpisodeError

LATEST_S = 1.0
"""Messages may be recorded this much later than others that are stamped after them: several threads published them."""


def require_steady_stamps(stamps_ns: Sequence[int] | np.ndarray, label: str) -> None:
    """Check that the stamps are of one clock that ran through.

    Args:
        stamps_ns: [T] nanoseconds, in the order of the recording.
        label: the recording and its topic, for the message.

    Raises:
        EpisodeError: from one message to the next a stamp jumps ahead, or goes back by more than late messages do.
    """
    stamps = np.asarray(stamps_ns, np.int64)
    steps = np.diff(stamps) * 1e-9
    jumps = np.flatnonzero((steps > LONGEST_GAP_S) | (steps < -LATEST_S))
    if not len(jumps):
        return
    frame = int(jumps[0])
    before, after = (stamps[each] * 1e-9 for each in (frame, frame + 1))
    ahead = steps[frame] > 0
    limit = f"at most {LONGEST_GAP_S:g} s ahead" if ahead else f"at most {LATEST_S:g} s back"
    raise EpisodeError(
        f"{label}: the stamps jump {'ahead' if ahead else 'back'} by {abs(steps[frame]):.3f} s from frame {frame} "
        f"({before:.3f} s) to frame {frame + 1} ({after:.3f} s), in one recording {limit}; was a clock set, or do "
        "two of them stamp? Stamp by one clock, or cut the recording there and give its parts as episodes"
    )
