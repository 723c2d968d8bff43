"""`egophys rehearse --out DIR`."""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from egophys_core.cli.display import print_json, progress_bar
from egophys_core.cli.seed_argument import seed
from egophys_core.errors import OptionsError
from egophys_core.files import new_folder
from egophys_core.options import from_mapping, to_mapping
from egophys_core.rehearsal.options import Motion, RehearsalObject, RehearsalOptions

if TYPE_CHECKING:
    from egophys_core.episode import Episode

MOST_HANDS = 2
"""Of a person."""

NUMBERS = ("duration_s", "rate_hz", "points", "noise_m", "dropout", "spread")


@dataclass(frozen=True, kw_only=True)
class Handling:
    """One episode to be made."""

    folder: str
    """Within the folder that is made: its name, by which a diagnosis tells it from others."""
    about: dict[str, Any]
    """What `truth.json` says of it."""
    record: "Callable[..., Episode]"
    """Makes it; its argument `report` is told the share done."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the subcommand."""
    parser.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder to make: a bag an episode, and truth.json"
    )
    parser.add_argument("--object", choices=[str(each) for each in RehearsalObject], default="sheet")
    parser.add_argument(
        "--motions",
        nargs="+",
        choices=[str(each) for each in Motion],
        default=["lift", "double_pull", "double_lift", "pull"],
        metavar="MOTION",
        help=f"an episode each, of {', '.join(Motion)}; default lift double_pull double_lift pull",
    )
    parser.add_argument(
        "--plan",
        nargs="+",
        default=[],
        type=Path,
        metavar="PLAN",
        help="one episode, in which hands do as plan files say, a file a hand, as `egophys experiment` writes them; in "
        "place of --motions and --duration-s",
    )
    parser.add_argument(
        "--effect",
        nargs="+",
        default=["none"],
        metavar="NAME",
        help="injected effects by name, as quadratic_drag; default none. A wrong name lists them all",
    )
    parser.add_argument("--size", choices=("small", "large"), default="large", help="of the effects; default large")
    parser.add_argument(
        "--parameter",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="of the effect, in SI units, in place of the size's; EFFECT.NAME=VALUE where there are several effects",
    )
    parser.add_argument("--seed", type=seed, default=0, help="of the motions and of what is seen; default 0")
    parser.add_argument("--object-seed", type=seed, default=0, help="of the object; default 0")
    for name in NUMBERS:
        field = RehearsalOptions.__dataclass_fields__[name]
        low, high, doc = (field.metadata[key] for key in ("low", "high", "doc"))
        parser.add_argument(
            f"--{name.replace('_', '-')}",
            type=type(field.default),
            default=field.default,
            help=f"{doc} ({low:g} .. {high:g}; default {field.default})",
        )
    parser.add_argument("--no-occlusion", dest="occlusion", action="store_false", help="see all points from all sides")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a sentence")


def run(parsed: argparse.Namespace) -> int:
    """Rehearse and write."""
    from egophys_core.recording import write_episode

    options = from_mapping(
        RehearsalOptions, {name: getattr(parsed, name) for name in ("object", "occlusion", *NUMBERS)}
    )
    effects = _effects(parsed)
    handlings = _handlings(parsed, options, effects)
    truth = _truth(parsed, options, effects, [{"folder": each.folder, **each.about} for each in handlings])
    with new_folder(parsed.out) as making, progress_bar() as report:
        for number, each in enumerate(handlings):
            episode = each.record(
                report=lambda share, each=each, number=number: report(
                    "rehearse", (number + share) / len(handlings), each.about["motion"]
                )
            )
            write_episode(episode, making / each.folder)
        (making / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    if parsed.json:
        print_json({"folder": str(parsed.out), **truth})
    else:
        print(
            f"{len(handlings)} episode{'s' * (len(handlings) != 1)} of a {options.object} with "
            f"{', '.join(effects) or 'no effect'} written to {parsed.out}"
        )
    return 0


def _handlings(
    parsed: argparse.Namespace, options: RehearsalOptions, effects: dict[str, dict[str, float]]
) -> list[Handling]:
    """The episodes that are asked for: one of plans, or one a motion."""
    from egophys_core.plan_file import read_plan
    from egophys_core.rehearsal import rehearse as rehearse_episode
    from egophys_core.rehearsal import rehearse_plans

    if len({path.resolve() for path in parsed.plan}) != len(parsed.plan) or len(parsed.plan) > MOST_HANDS:
        raise OptionsError(
            f"--plan takes a file a hand, at most {MOST_HANDS} different ones, got {', '.join(map(str, parsed.plan))}"
        )
    world: dict[str, Any] = {"effects": effects, "object_seed": parsed.object_seed}
    if parsed.plan:
        plans = [read_plan(path).plan for path in parsed.plan]
        name = f"{options.object}_plan_{parsed.seed}"
        return [
            Handling(
                # Several experiments go into one diagnosis.
                folder=parsed.out.name,
                about={"motion": "plan", "plans": [path.name for path in parsed.plan], "seed": parsed.seed},
                record=partial(rehearse_plans, options, plans, name=name, seed=parsed.seed, **world),
            )
        ]
    return [
        Handling(
            folder=f"episode_{number}",
            about={"motion": motion, "seed": parsed.seed + number},
            record=partial(rehearse_episode, options, Motion(motion), seed=parsed.seed + number, **world),
        )
        for number, motion in enumerate(parsed.motions)
    ]


def _effects(parsed: argparse.Namespace) -> dict[str, dict[str, float]]:
    """What to inject, with every parameter."""
    from egophys_core.rehearsal import complete_effects, injected_sizes

    names = [] if parsed.effect == ["none"] else parsed.effect
    effects = {name: injected_sizes(name)[parsed.size] for name in names}
    for assignment in parsed.parameter:
        place, _, value = assignment.partition("=")
        effect, _, parameter = place.rpartition(".")
        effect = effect or (names[0] if len(names) == 1 else "")
        if effect not in effects:
            raise OptionsError(
                f"--parameter {assignment}: give EFFECT.NAME=VALUE with an effect of --effect, "
                f"which are {', '.join(effects) or 'none'}"
            )
        try:
            effects[effect][parameter] = float(value)
        except ValueError:
            raise OptionsError(f"--parameter {assignment}: {value!r} is no number") from None
    return complete_effects(effects)


def _truth(
    parsed: argparse.Namespace,
    options: RehearsalOptions,
    effects: dict[str, dict[str, float]],
    episodes: list[dict[str, Any]],
) -> dict[str, Any]:
    """What is in the episodes, for whoever judges a diagnosis of them."""
    from egophys_core.rehearsal import INJECTABLE

    return {
        "object": str(options.object),
        "object_seed": parsed.object_seed,
        "effects": [
            {
                "name": name,
                "equation": INJECTABLE[name].equation,
                "parameters": {
                    key: {"value": value, "unit": INJECTABLE[name].units[key]} for key, value in values.items()
                },
            }
            for name, values in effects.items()
        ],
        "episodes": episodes,
        "options": to_mapping(options),
    }
