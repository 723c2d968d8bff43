"""Command-line arguments for motions that are asked for: whose hands do them, how many, and in which world."""

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from egophys_core.cli.rehearsed_truth import read_truth
from egophys_core.errors import OptionsError

if TYPE_CHECKING:
    from egophys_core.episode import Episode
    from egophys_core.experiments import HandLimits, Proposal
    from egophys_core.experiments.asking import World
    from egophys_core.twin import Twin


def add_hand_arguments(parser: argparse.ArgumentParser) -> None:
    """Whose hands do a motion."""
    parser.add_argument(
        "--by",
        choices=("person", "arm"),
        default="person",
        help="who does motions: a person with two hands, or one arm within the bridge's limits (default person). "
        "Motions are held against these as if the arm stood best for each: the table at z = 0 of its base, its box "
        "about the motion in x and y",
    )
    parser.add_argument(
        "--limits", type=Path, metavar="FILE", help="YAML of the arm's limits, as the bridge takes it (default its own)"
    )


def add_ask_arguments(parser: argparse.ArgumentParser) -> None:
    """How often to ask, and whom."""
    parser.add_argument(
        "--ask",
        type=int,
        default=0,
        metavar="N",
        help="as long as nothing is decided, have a motion done that would show more, and diagnose again with it; N "
        "times at most (default 0); what was not measured directly is decided only after one",
    )
    parser.add_argument(
        "--world",
        type=Path,
        metavar="DIR",
        help="where motions are done: a folder of `egophys rehearse`, whose object is handled again; what is recorded "
        "stays in the folder beside --out that ends in _asked",
    )
    add_hand_arguments(parser)


def check_ask(parsed: argparse.Namespace) -> None:
    """Check that the arguments of `add_ask_arguments` go together.

    Raises:
        OptionsError: they do not.
    """
    if (parsed.ask > 0) != (parsed.world is not None) or parsed.ask < 0:
        raise OptionsError("--ask N and --world DIR go together: how often to ask, and where motions are done")
    if not parsed.ask and (parsed.by != "person" or parsed.limits is not None):
        raise OptionsError("--by and --limits are of motions that are asked for; add --ask N, or leave them out")


def hands_of(parsed: argparse.Namespace) -> "HandLimits":
    """What the hands that were chosen can do.

    Raises:
        OptionsError: limits of an arm are given for a person, or cannot be read.
    """
    from egophys_core.experiments import PERSON, arm_hands
    from egophys_core.robot import MotionLimits

    if parsed.by == "person":
        if parsed.limits is not None:
            raise OptionsError(f"--limits {parsed.limits} are an arm's; add --by arm, or leave them out")
        return PERSON
    return arm_hands(MotionLimits.load(parsed.limits) if parsed.limits else MotionLimits())


def rehearsed_world(folder: Path, twin: "Twin", out: Path) -> "World":
    """The world of a rehearsal: its object, handled as proposed.

    Args:
        folder: that `egophys rehearse` made.
        twin: whose plans are executed.
        out: a new folder that keeps each motion as `motion_K`: the experiment, and the recording `motion_K`.

    Raises:
        OptionsError: it is no such folder.
    """
    from egophys_core.experiments import save_experiment
    from egophys_core.experiments.hand_path import plan_of_path
    from egophys_core.recording import write_episode
    from egophys_core.rehearsal import rehearse_plans

    truth = read_truth(folder)

    def handle(proposal: "Proposal", number: int) -> "Episode":
        name = f"motion_{number}"
        out.mkdir(exist_ok=True)
        save_experiment([proposal], twin, out / name, stamp_ns=time.time_ns())
        plans = [plan_of_path(each, twin.twin_id) for each in proposal.motion.paths]
        # Another seed than those of the folder, so that it is seen with noise of its own.
        seed = 1000 + number + truth.last_seed
        episode = rehearse_plans(
            truth.options, plans, name=name, seed=seed, effects=truth.effects, object_seed=truth.object_seed
        )
        write_episode(episode, out / name / name)
        return episode

    return handle
