"""Whether a twin is worth its physics: it must predict held-out frames better than predictions without any."""

from collections.abc import Mapping

from egophys_core.episode import Episode
from egophys_core.evaluation.scores import Scores

TELLING = 0.6
"""Share of the points that must be seen in held-out frames. In videos that show less, what moves most is hidden: there
twins lost by the points that were seen and won by all that were measured (docs/notes/grips.md)."""


def lost_to(twin: Scores, baselines: Mapping[str, Scores], episode: Episode) -> str:
    """A sentence about the best of the baselines that predict the held-out frames better, by track error; or empty."""
    better = {name: each.test_track_m for name, each in baselines.items() if each.test_track_m < twin.test_track_m}
    if not better:
        return ""
    name = min(better, key=better.__getitem__)
    found = (
        f"it is off by {1000 * twin.test_track_m:.1f} mm on the held-out frames, '{name}' by {1000 * better[name]:.1f}"
    )
    seen = episode.visible[episode.train_frames :, episode.visible[0]].mean()
    if seen < TELLING:
        return (
            f"whether this twin predicts better than no physics is not told: {found}, but only {seen:.0%} of the "
            "points are seen there, mostly those that lie still; evaluate it on a recording that shows more"
        )
    return (
        f"this twin predicts worse than no physics: {found}; do not plan with it, but build from another recording "
        "(slower, or handled in another way), or from more than one, or with more generations"
    )
