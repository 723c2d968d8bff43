"""Whether a twin is worth its physics: it must predict held-out frames better than predictions without any."""

from collections.abc import Mapping

from egophys_core.evaluation.scores import Scores


def lost_to(twin: Scores, baselines: Mapping[str, Scores]) -> str:
    """A sentence about the best of the baselines that predict the held-out frames better, by track error; or empty."""
    better = {name: each.test_track_m for name, each in baselines.items() if each.test_track_m < twin.test_track_m}
    if not better:
        return ""
    name = min(better, key=better.__getitem__)
    return (
        f"this twin predicts worse than no physics: it is off by {1000 * twin.test_track_m:.1f} mm on the held-out "
        f"frames, '{name}' by {1000 * better[name]:.1f}; do not plan with it, but build from another recording "
        "(slower, or handled in another way), or from more than one, or with more generations"
    )
