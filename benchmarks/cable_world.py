"""A cable between two hands in MuJoCo's cable plugin, seen at markers as motion capture sees them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.episode import Episode
from egophys_core.rehearsal.engine import load_mujoco
from egophys_core.rehearsal.field_forces import hidden_tether
from egophys_core.rehearsal.handled_body import gravity_with, with_added_mass
from egophys_core.rehearsal.injected_forces import FIELDS
from egophys_core.rehearsal.injection import Effects, complete_effects
from egophys_core.rehearsal.observation import in_tracking_frame, mistracked
from egophys_core.rehearsal.state import StepState

LENGTH, RADIUS, MASS = 1.0, 0.004, 0.05
"""Metres; kg."""

PIECES = 48
MODULUS = 4.2e6
"""Pa: under its own weight it bends within 0.12 m."""

DAMPING = 1e-3
"""N m s/rad of each joint between two pieces."""

STEP, FRAME = 0.00025, 0.01
"""Seconds."""

SETTLING, SETTLING_DRAG = 4.0, 8.0
"""Seconds from lying straight to hanging between the hands, before a record; 1/s, of a drag that brings it to rest."""

COILED = 2.0
"""1/m, intrinsic curvature of a cable that was kept on a coil, if it was: to the side, as the hands hold it."""

FREE_MARKERS, HELD = 9, 2
"""Evenly spread between the hands; at each end of them, where a hand holds the last piece by both its ends."""

NOISE = 0.0002
"""Metres, of a marker's place."""

Hands = Callable[[float], np.ndarray]
"""By seconds: [2, 5] of each hand its place (m), yaw and pitch (rad)."""


@dataclass(frozen=True, kw_only=True)
class Hanging:
    """How the hands move: each of their coordinates oscillates about its start, and eases in within half a second."""

    name: str
    start: np.ndarray
    """[2, 5] metres and rad."""
    oscillations: dict[tuple[int, int], tuple[float, float]]
    """By hand and coordinate: size (m, rad) and frequency (Hz)."""

    def __call__(self, time: float) -> np.ndarray:
        """[2, 5] places and turns of the hands after so many seconds."""
        eased = min(time / 0.5, 1.0)
        eased = eased * eased * (3.0 - 2.0 * eased)
        hands = self.start.copy()
        for (hand, coordinate), (size, frequency) in self.oscillations.items():
            hands[hand, coordinate] += size * eased * np.sin(2.0 * np.pi * frequency * time)
        return hands


def _between(width: float) -> np.ndarray:
    """[2, 5] two hands so many metres apart that let the cable sag."""
    return np.array([[0.0, 0.0, 1.0, 0.0, 0.3], [width, 0.0, 1.0, 0.0, -0.3]])


MOTIONS = (
    Hanging(name="up_and_down", start=_between(0.7), oscillations={(1, 2): (0.12, 0.8)}),
    Hanging(
        name="aside",
        start=_between(0.7),
        oscillations={(0, 1): (0.08, 1.1), (1, 0): (-0.12, 0.6), (0, 3): (0.3, 0.6), (1, 4): (0.3, 0.6)},
    ),
    Hanging(
        name="all_ways",
        start=_between(0.6),
        oscillations={
            (0, 0): (0.05, 1.3),
            (0, 2): (0.08, 0.5),
            (1, 1): (0.1, 1.3),
            (1, 2): (-0.1, 0.5),
            (0, 4): (0.2, 0.5),
            (1, 3): (0.4, 1.3),
        },
    ),
)


def record(
    hanging: Hanging,
    *,
    seconds: float,
    effects: Mapping[str, Mapping[str, float]],
    seed: int,
    intrinsic_curvature: float = 0.0,
) -> Episode:
    """The markers of a moved cable, 100 frames a second.

    Args:
        hanging: how the hands move.
        seconds: of the record.
        effects: injected ones, as in `egophys_core.rehearsal.injection`; what is at rest there hangs here when the
            record begins, or lies straight from (0, 0, 1) to (1, 0, 1) for added mass.
        seed: of the markers' noise.
        intrinsic_curvature: 1/m, of the cable when nothing acts on it, aside.
    """
    injected = complete_effects(effects)
    mujoco = load_mujoco()
    model: Any = mujoco.MjModel.from_xml_string(_scene(_arc(intrinsic_curvature)))
    data: Any = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    first = model.body("cB_first").id
    pieces = slice(first, first + PIECES)
    model.opt.gravity[:] = gravity_with(injected)
    if "uneven_mass" in injected:
        heavier = with_added_mass(data.xipos[pieces].copy(), model.body_mass[pieces].copy(), injected["uneven_mass"])
        model.body_inertia[pieces] *= (heavier / model.body_mass[pieces])[:, None]
        model.body_mass[pieces] = heavier
        mujoco.mj_setConst(model, data)
    masses = model.body_mass[pieces].copy()
    terms = [make(injected[name]) for name, make in FIELDS.items() if name in injected]
    half_turn = 0.5 * intrinsic_curvature * LENGTH * (1.0 - 1.0 / PIECES)
    lying = np.array([[0.0, 0.0, 1.0, -half_turn, 0.0], [*data.site("cS_last").xpos, half_turn, 0.0]])
    before = data.xipos[pieces].copy()

    def advance(time: float, hands: np.ndarray, drag: float) -> None:
        places = data.xipos[pieces].copy()
        state = StepState(
            time=time,
            duration=STEP,
            positions=places,
            velocities=(places - before) / STEP,
            masses=masses,
            pressures=np.zeros(PIECES),
        )
        forces = -drag * masses[:, None] * state.velocities
        for term in terms:
            term(state, forces)
        before[:] = places
        data.xfrc_applied[pieces, :3] = forces
        _put(data, hands)
        mujoco.mj_step(model, data)

    for step in range(int(SETTLING / STEP)):
        share = min(step * STEP / (0.4 * SETTLING), 1.0)
        eased = share * share * (3.0 - 2.0 * share)
        advance(step * STEP - SETTLING, lying + eased * (hanging(0.0) - lying), SETTLING_DRAG)
    if "hidden_tether" in injected:
        terms.append(hidden_tether(injected["hidden_tether"], before))
    delay = injected.get("control_delay", {"delay": 0.0})["delay"]
    places = []
    for frame in range(round((seconds + delay) / FRAME)):
        last = data.body("cB_last")
        tip = last.xpos + last.xmat.reshape(3, 3)[:, 0] * LENGTH / PIECES
        places.append(np.concatenate([data.xpos[pieces], [tip]]))
        for step in range(round(FRAME / STEP)):
            time = frame * FRAME + step * STEP
            advance(time, hanging(time), 0.0)
    free = np.linspace(1, PIECES - 1, FREE_MARKERS + 2)[1:-1].round().astype(int)
    seen = np.array(places)[:, [0, 1, *free, PIECES - 1, PIECES]]
    return _episode(hanging.name, seen, injected, round(delay / FRAME), np.random.default_rng(seed))


def _episode(name: str, seen: np.ndarray, injected: Effects, early: int, random: np.random.Generator) -> Episode:
    """Markers [T, M, 3] with noise, as they are tracked; the first and last two are held, and some frames early."""
    noisy = seen + random.normal(0.0, NOISE, seen.shape)
    frames = len(noisy) - early
    free, held = noisy[:frames, HELD:-HELD], np.concatenate([noisy[early:, :HELD], noisy[early:, -HELD:]], axis=1)
    points = mistracked(free.reshape(-1, 3), injected).reshape(free.shape).astype(np.float32)
    held = in_tracking_frame(held.reshape(-1, 3), injected).reshape(held.shape)
    return Episode(
        name=name,
        times=FRAME * np.arange(frames),
        points=points,
        confidence=np.ones(points.shape[:2], np.float32),
        point_ids=np.arange(points.shape[1], dtype=np.uint32),
        controllers=held.astype(np.float32),
        controller_ids=np.arange(held.shape[1], dtype=np.uint32),
    )


def _put(data: Any, hands: np.ndarray) -> None:
    """Move the hands [2, 5] there."""
    data.mocap_pos[:] = hands[:, :3]
    data.mocap_quat[:] = Rotation.from_euler("zy", hands[:, 3:]).as_quat()[:, [3, 0, 1, 2]]


def _arc(bend: float) -> np.ndarray:
    """[PIECES + 1, 3] metres from the first end: a cable that lies level and is bent so much, 1/m, along x."""
    turns = bend * LENGTH / PIECES * (np.arange(PIECES) - 0.5 * (PIECES - 1))
    steps = LENGTH / PIECES * np.stack([np.cos(turns), np.sin(turns), np.zeros(PIECES)], axis=1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _scene(lying: np.ndarray) -> str:
    """With a cable that is at rest along places [PIECES + 1, 3], metres."""
    vertices = " ".join(f"{number:.9f}" for number in lying.ravel())
    piece = LENGTH / PIECES
    # Half a ball at both ends of each is of the piece, too.
    volume = np.pi * RADIUS**2 * piece + 4.0 / 3.0 * np.pi * RADIUS**3
    return f"""
<mujoco>
  <extension><plugin plugin="mujoco.elasticity.cable"/></extension>
  <option timestep="{STEP}" integrator="implicitfast"/>
  <worldbody>
    <body name="left" mocap="true" pos="0 0 1"/>
    <body name="right" mocap="true" pos="{LENGTH} 0 1"/>
    <composite type="cable" prefix="c" vertex="{vertices}" offset="0 0 1" initial="free">
      <plugin plugin="mujoco.elasticity.cable">
        <config key="twist" value="{MODULUS}"/><config key="bend" value="{MODULUS}"/><config key="vmax" value="0"/>
        <config key="flat" value="false"/>
      </plugin>
      <joint kind="main" damping="{DAMPING}"/>
      <geom type="capsule" size="{RADIUS}" density="{MASS / PIECES / volume}" contype="0" conaffinity="0"/>
    </composite>
  </worldbody>
  <equality>
    <weld body1="left" body2="cB_first" relpose="0 0 0 1 0 0 0" solref="0.004 1"/>
    <weld body1="right" body2="cB_last" relpose="{-piece} 0 0 1 0 0 0" solref="0.004 1"/>
  </equality>
</mujoco>"""
