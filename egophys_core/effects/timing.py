"""When an effect acts: a window of time told apart more finely than frames are."""

from egophys_core.effects.effect import Scene

LATEST = 60.0
"""Seconds: no episode is longer."""


def share_of_frame(scene: Scene, begins: float, ends: float) -> float:
    """0..1: how much of the coming frame lies between two times, seconds since the start of the episode."""
    first, last = max(scene.time, begins), min(scene.time + scene.duration, ends)
    return max(last - first, 0.0) / scene.duration
