"""One episode of the rehearsal world, as a lab would record it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from egophys_core.episode import Episode
from egophys_core.errors import OptionsError
from egophys_core.rehearsal.bodies import SoftBody, make_body
from egophys_core.rehearsal.handled_body import HandledBody
from egophys_core.rehearsal.hands import Script, hand_cloud, script_of_plans, write_script
from egophys_core.rehearsal.observation import CONFIDENCE, in_tracking_frame, observe
from egophys_core.rehearsal.options import Motion, RehearsalOptions
from egophys_core.waypoint_plan import WaypointPlan

NOTHING: Mapping[str, Mapping[str, float]] = {}


def rehearse(
    options: RehearsalOptions,
    motion: Motion,
    *,
    seed: int,
    effects: Mapping[str, Mapping[str, float]] = NOTHING,
    object_seed: int = 0,
    report: Callable[[float], None] = lambda share: None,
) -> Episode:
    """Handle an object once.

    Args:
        options: the object and how it is observed.
        motion: what the hands do.
        seed: of the motion's details, noise and dropouts.
        effects: what is injected, by name; parameters not given have their small size.
        object_seed: of the object: size, mass, stiffness, friction, tracked points.
        report: told the share done, 0..1.

    Returns:
        What was seen; bit for bit the same for the same arguments.

    Raises:
        OptionsError: an effect or parameter is unknown; suggests the nearest.
        EgophysError: MuJoCo is not installed.
        SimulationError: the body diverged.
    """
    return rehearse_body(
        make_body(options, object_seed),
        options,
        motion,
        name=f"{options.object}_{motion}_{seed}",
        seeds=(seed, object_seed),
        effects=effects,
        report=report,
    )


def rehearse_body(
    body: SoftBody,
    options: RehearsalOptions,
    motion: Motion,
    *,
    name: str,
    seeds: Sequence[int],
    effects: Mapping[str, Mapping[str, float]] = NOTHING,
    report: Callable[[float], None] = lambda share: None,
) -> Episode:
    """Handle a given body once; `rehearse` says more.

    Args:
        body: what lies on the table.
        options: how it is observed; what they say of the object does not matter here.
        motion: what the hands do.
        name: of the episode.
        seeds: of the motion's details, noise and dropouts.
        effects: what is injected.
        report: told the share done, 0..1.
    """
    motion_random, observation_random = np.random.default_rng(seeds).spawn(2)
    handled = HandledBody(body, effects, pressing=int(motion is Motion.PUSH), folding=motion is Motion.FOLD)
    script = write_script(motion, body, handled.vertices, motion_random)
    cloud = hand_cloud(script.centres.shape[1], motion_random)
    return _recorded(handled, script, cloud, options, name=name, random=observation_random, report=report)


def rehearse_plans(
    options: RehearsalOptions,
    plans: Sequence[WaypointPlan],
    *,
    name: str,
    seed: int,
    effects: Mapping[str, Mapping[str, float]] = NOTHING,
    object_seed: int = 0,
    report: Callable[[float], None] = lambda share: None,
) -> Episode:
    """Handle an object once as plans say, one a hand; `rehearse` says more.

    The episode lasts as long as they do.

    Args:
        options: the object and how it is observed; their duration does not matter here.
        plans: in the frame in which the object lies at the start.
        name: of the episode.
        seed: of hand points, noise and dropouts.
        effects: what is injected.
        object_seed: of the object.
        report: told the share done.

    Raises:
        PlanningError: the plans do not fit together.
    """
    script = script_of_plans(plans)
    hand_random, observation_random = np.random.default_rng((seed, object_seed)).spawn(2)
    handled = HandledBody(make_body(options, object_seed), effects)
    cloud = hand_cloud(len(plans), hand_random)
    options = replace(options, duration_s=float(script.times[-1]))
    return _recorded(handled, script, cloud, options, name=name, random=observation_random, report=report)


def _recorded(
    handled: HandledBody,
    script: Script,
    cloud: np.ndarray,
    options: RehearsalOptions,
    *,
    name: str,
    random: np.random.Generator,
    report: Callable[[float], None],
) -> Episode:
    """What is seen of a body that hands with points [H, C / H, 3] about their centres move by a script."""
    true_hands = handled.true_hands(script.at)
    closes, opens = script.closes + handled.delay, script.opens + handled.delay
    times = np.arange(max(2, round(options.duration_s * options.rate_hz))) / options.rate_hz
    hands = np.stack([script.at(time).points(cloud) for time in times])
    points = np.empty((len(times), len(handled.body.tracked_triangles), 3), np.float32)
    for frame, time in enumerate(times):
        for change, act in ((closes, lambda: handled.close_grip(true_hands(closes))), (opens, handled.open_grip)):
            if time >= change > handled.time:
                handled.advance(true_hands, change)
                act()
        handled.advance(true_hands, time)
        points[frame] = observe(handled.points, hands[frame], options, handled.effects, random)
        if frame == 0 and np.isnan(points[0]).all():
            raise OptionsError(
                f"none of the {len(points[0])} points is seen in the first frame: raise points or lower dropout "
                f"({options.dropout:g})"
            )
        report((frame + 1) / len(times))
    seen = np.isfinite(points).all(axis=2)
    ever = seen.any(axis=0)
    return Episode(
        name=name,
        times=times,
        points=points[:, ever],
        confidence=np.where(seen[:, ever], CONFIDENCE, 0.0).astype(np.float32),
        point_ids=np.flatnonzero(ever).astype(np.uint32),
        controllers=in_tracking_frame(hands.reshape(-1, 3), handled.effects).reshape(hands.shape).astype(np.float32),
        controller_ids=np.arange(hands.shape[1], dtype=np.uint32),
    )
