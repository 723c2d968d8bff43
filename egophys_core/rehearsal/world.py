"""One episode of the rehearsal world, as a lab would record it."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from egophys_core.episode import Episode
from egophys_core.rehearsal.bodies import SoftBody, make_body
from egophys_core.rehearsal.handled_body import HandledBody
from egophys_core.rehearsal.hands import CONTACT_BEGINS, hand_cloud, write_script
from egophys_core.rehearsal.observation import CONFIDENCE, in_tracking_frame, observe
from egophys_core.rehearsal.options import Motion, RehearsalOptions

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
    true_hands = handled.true_hands(script.at)
    grip_closes = CONTACT_BEGINS + handled.delay
    times = np.arange(max(2, round(options.duration_s * options.rate_hz))) / options.rate_hz
    hands = np.stack([(script.at(time)[:, None] + cloud).reshape(-1, 3) for time in times])
    points = np.empty((len(times), len(body.tracked_triangles), 3), np.float32)
    for frame, time in enumerate(times):
        if script.grips and time >= grip_closes > handled.time:
            handled.advance(true_hands, grip_closes)
            handled.close_grip(true_hands(grip_closes))
        handled.advance(true_hands, time)
        points[frame] = observe(handled.points, hands[frame], options, handled.effects, observation_random)
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
