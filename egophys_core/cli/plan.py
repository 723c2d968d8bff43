"""`egophys plan TWIN --target EPISODE --out PLAN`."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from egophys_core.cli.display import progress_bar
from egophys_core.cli.option_arguments import add_option_arguments, options_from
from egophys_core.errors import PlanningError
from egophys_core.files import require_writable, write_atomically
from egophys_core.planning.options import PlanOptions

if TYPE_CHECKING:
    import numpy as np


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("twin", type=Path, metavar="TWIN")
    parser.add_argument(
        "--target",
        required=True,
        type=Path,
        metavar="SHAPE",
        help="an episode (its points at --target-frame) or an .npy file of [P, 3] metres, world",
    )
    parser.add_argument("--target-frame", type=int, default=-1, help="frame of the episode (default: the last)")
    parser.add_argument("--out", required=True, type=Path, metavar="PLAN", help="JSON file to write")
    parser.add_argument("--seed", type=int, default=0, help="seed of the samples (default 0)")
    add_option_arguments(parser, PlanOptions)


def run(parsed: argparse.Namespace) -> int:
    """Plan and write."""
    from egophys_core.planning import grasp_from_points, plan_to_target, twin_costs
    from egophys_core.twin import load_twin
    from egophys_core.waypoint_plan import plan_to_json

    require_writable(parsed.out)
    options, twin = options_from(parsed, PlanOptions), load_twin(parsed.twin)
    target = _target(parsed.target, parsed.target_frame)
    with progress_bar() as report:
        plan, initial_cost = plan_to_target(
            lambda plans: twin_costs(twin, plans, target),
            grasp_from_points(twin.grasp),
            options,
            seed=parsed.seed,
            twin_id=twin.twin_id,
            progress=lambda done, total, cost: report("plan", done / total, f"cost {1000 * cost:.1f} mm"),
        )
    try:
        write_atomically(parsed.out, json.dumps(plan_to_json(plan), indent=1).encode())
    except OSError as error:
        raise PlanningError(f"cannot write plan {parsed.out}: {error.strerror}") from error
    print(
        f"distance to the target: {1000 * initial_cost:.1f} mm before, {1000 * plan.predicted_cost:.1f} mm predicted; "
        f"{len(plan.times)} waypoints over {plan.times[-1]:.1f} s written to {parsed.out}"
    )
    return 0


def _target(path: Path, frame: int) -> "np.ndarray":
    import numpy as np

    from egophys_core.recording import read_episode

    if path.suffix == ".npy":
        try:
            return np.load(path, allow_pickle=False)
        except (OSError, ValueError) as error:
            raise PlanningError(f"cannot read target {path}: {error}") from error
    episode = read_episode(path)
    if not -episode.frames <= frame < episode.frames:
        raise PlanningError(f"{path} has frames 0 .. {episode.frames - 1}, not {frame}")
    points = episode.points[frame]
    return points[np.isfinite(points).all(axis=1)]
