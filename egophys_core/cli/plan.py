"""`egophys plan TWIN [--target SHAPE] [--translate X Y Z] [--rotate R P Y] --out PLAN`."""

import argparse
import time
from pathlib import Path

from egophys_core.cli.display import progress_bar
from egophys_core.cli.option_arguments import add_option_arguments, options_from
from egophys_core.cli.seed_argument import seed
from egophys_core.files import require_writable
from egophys_core.planning.options import PlanOptions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument("twin", type=Path, metavar="TWIN")
    parser.add_argument(
        "--target",
        default="present",
        metavar="SHAPE",
        help="`present` (the default, to be edited), a point cloud (.npy .ply .pcd .xyz .csv, metres, world), a frame "
        "of a bag (towel.mcap@2.3s, towel.mcap@70; by default the last), or another twin; ' translate=X,Y,Z' and "
        "' rotate=R,P,Y' may follow it",
    )
    parser.add_argument("--translate", type=float, nargs=3, metavar=("X", "Y", "Z"), help="shift the target, m")
    parser.add_argument(
        "--rotate", type=float, nargs=3, metavar=("R", "P", "Y"), help="turn the target about its centre, degrees"
    )
    parser.add_argument(
        "--start",
        metavar="SHAPE",
        help="where the object is now: a frame of a bag that begins with it at rest, or a point cloud of it as it lay "
        "for the twin (default: where the twin was built)",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="PLAN", help="JSON file to write")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the samples (default 0)")
    add_option_arguments(parser, PlanOptions)


def run(parsed: argparse.Namespace) -> int:
    """Plan and write; 1 if the plan does not reach its target."""
    from egophys_core.plan_file import PLAN_FILE, PlanFile, write_plan
    from egophys_core.planning import (
        grasp_from_points,
        parse_target,
        path_and_frame,
        plan_to_target,
        start_of_source,
        start_of_twin,
        target_points,
        twin_costs,
    )
    from egophys_core.twin import load_twin

    given = {name: getattr(parsed, name) for name in ("translate", "rotate")}
    edits = [f"{name}={','.join(map(str, values))}" for name, values in given.items() if values]
    wanted = parse_target(" ".join([parsed.target, *edits]))
    read = [path_and_frame(each)[0] for each in (wanted.source, parsed.start) if each]
    require_writable(parsed.out, PLAN_FILE, inputs=[parsed.twin, *read])
    options, twin = options_from(parsed, PlanOptions), load_twin(parsed.twin)
    start = start_of_source(parsed.start, twin) if parsed.start else start_of_twin(twin)
    target = target_points(wanted, start.surface(twin))
    with progress_bar() as report:
        plan, initial_cost = plan_to_target(
            lambda plans: twin_costs(twin, plans, target, start=start),
            grasp_from_points(start.grasp),
            options,
            seed=parsed.seed,
            twin_id=twin.twin_id,
            progress=lambda done, total, cost: report("plan", done / total, f"cost {1000 * cost:.1f} mm"),
        )
    content = PlanFile(plan=plan, stamp_ns=time.time_ns(), tolerance=options.tolerance_m)
    write_plan(parsed.out, content)
    print(
        f"distance to the target: {1000 * initial_cost:.1f} mm before, {1000 * plan.predicted_cost:.1f} mm predicted, "
        f"{1000 * options.tolerance_m:.1f} mm tolerated: {'reached' if content.reached else 'not reached'}; "
        f"{len(plan.times)} waypoints over {plan.times[-1]:.1f} s written to {parsed.out}"
    )
    return 0 if content.reached else 1
