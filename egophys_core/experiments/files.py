"""What a proposed experiment leaves on disk: plan files, a picture, and what it is expected to show, in one folder."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from egophys_core.experiments.choice import Proposal
from egophys_core.experiments.hand_path import plan_of_path
from egophys_core.experiments.prediction import predicted_episode
from egophys_core.files import new_folder, write_json
from egophys_core.json_numbers import nulled
from egophys_core.plan_file import PlanFile, write_plan
from egophys_core.reporting import draw_shapes
from egophys_core.twin import Twin

EXPERIMENT_NAME = "experiment.json"

PICTURED = 4
"""Moments of a motion in its picture."""


def save_experiment(proposals: Sequence[Proposal], twin: Twin, folder: Path, *, stamp_ns: int) -> dict[str, Any]:
    """Write `experiment.json`, and for motion K `motion_K.png` and `motion_K_hand_H.json`, all or nothing.

    Args:
        proposals: the best first.
        twin: it was made with.
        folder: new or empty.
        stamp_ns: when, nanoseconds since the epoch.

    Returns:
        The content of `experiment.json`.

    Raises:
        OutputError: `folder` is a file or not empty, or cannot be made.
    """
    content = experiment_content(proposals, twin)
    with new_folder(folder) as part:
        for each, about in zip(proposals, content["motions"], strict=True):
            for path, name in zip(each.motion.paths, about["plans"], strict=True):
                plan = plan_of_path(path, twin.twin_id)
                write_plan(part / name, PlanFile(plan=plan, stamp_ns=stamp_ns, tolerance=float("nan")))
            _draw(part / about["picture"], each, twin)
        write_json(part / EXPERIMENT_NAME, nulled(content))
    return content


def experiment_content(proposals: Sequence[Proposal], twin: Twin) -> dict[str, Any]:
    """The content of `experiment.json`."""
    return {
        "twin_id": twin.twin_id,
        "motions": [
            {
                "name": each.motion.name,
                "sentence": each.motion.sentence,
                "seconds": each.motion.duration,
                "plans": [f"motion_{number}_hand_{hand}.json" for hand in range(1, 1 + len(each.motion.paths))],
                "picture": f"motion_{number}.png",
                "score": each.score,
                "limits_before": [asdict(limit) for limit in each.before],
                "limits_after": [asdict(limit) for limit in each.after],
            }
            for number, each in enumerate(proposals, start=1)
        ],
    }


def _draw(path: Path, proposal: Proposal, twin: Twin) -> None:
    """The predicted motion at some moments."""
    episode = predicted_episode(twin.model, proposal.motion, ground_height=twin.ground_height)
    frames = [round(share * (episode.frames - 1) / (PICTURED - 1)) for share in range(PICTURED)]
    draw_shapes(
        path,
        {f"{episode.times[frame]:.1f} s": episode.points[frame] for frame in frames},
        title=proposal.motion.name,
        ground=twin.ground_height,
    )
