"""A soft body on a table, with whatever effects are injected, and hands that the caller moves."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from egophys_core.constants import GRAVITY
from egophys_core.rehearsal.bodies import SoftBody
from egophys_core.rehearsal.engine import AIR_DAMPING, SETTLING_DAMPING, FlexEngine
from egophys_core.rehearsal.grip import Grip
from egophys_core.rehearsal.hands import Hands, HandsAt
from egophys_core.rehearsal.injected_forces import FRICTIONS, MATERIAL, injected_terms
from egophys_core.rehearsal.injection import Effects, complete_effects
from egophys_core.rehearsal.state import StepState

STEP = 0.0004
"""Seconds a step; the elastic forces are explicit and would diverge from about 0.0008 on."""

FINE_STEP = 0.0002
"""Seconds a step when injected forces stiffen the body."""

SETTLING = 0.6
"""Seconds that the body has to come to rest before time zero."""


class HandledBody:
    """One body through one episode; the caller moves the hands."""

    def __init__(
        self, body: SoftBody, effects: Mapping[str, Mapping[str, float]], *, pressing: int = 0, folding: bool = False
    ) -> None:
        """Inject the effects and let the body come to rest.

        Args:
            body: what lies on the table.
            effects: what is injected, with its parameters.
            pressing: how many hands press as balls; these never grip.
            folding: whether a sheet's layers touch each other, which takes two to four times as long.

        Raises:
            OptionsError: an effect or parameter is unknown.
            EgophysError: MuJoCo is not installed.
            SimulationError: the body does not come to rest.
        """
        self.effects = complete_effects(effects)
        self.body = body
        self.time = 0.0
        self._steps = 0
        self._pressing = pressing
        self._step_s = FINE_STEP if self.effects.keys() & MATERIAL else STEP
        self._engine = FlexEngine(body, step=self._step_s, pressing=pressing, folding=folding)
        self._grip: Grip | None = None
        self._last_centres: np.ndarray | None = None
        self._engine.set_gravity(gravity_with(self.effects))
        if "uneven_mass" in self.effects:
            self._engine.set_masses(with_added_mass(body.vertices, self._engine.masses, self.effects["uneven_mass"]))
        self._masses = self._engine.masses.copy()
        self._needs_pressures = bool(self.effects.keys() & FRICTIONS.keys())
        self._terms = injected_terms(self.effects, body, self._engine)
        self._settle()

    @property
    def vertices(self) -> np.ndarray:
        """[V, 3] metres, where the body truly is."""
        return self._engine.positions

    @property
    def points(self) -> np.ndarray:
        """[N, 3] metres, where the tracked points truly are."""
        return self.body.tracked(self._engine.positions)

    @property
    def delay(self) -> float:
        """Seconds by which the hands are behind their record."""
        return self.effects.get("control_delay", {"delay": 0.0})["delay"]

    def true_hands(self, recorded: HandsAt) -> HandsAt:
        """Where hands truly are whose record is `recorded`: late, and beside it, where that is injected."""
        delay = self.delay
        beside = self.effects.get("gripper_offset", {"x": 0.0, "y": 0.0, "z": 0.0})
        offset = np.array([beside["x"], beside["y"], beside["z"]])

        def truly(time: float) -> Hands:
            hands = recorded(time - delay)
            return replace(hands, centres=hands.centres + offset)

        return truly

    def close_grip(self, hands: Hands) -> None:
        """Hold from now on what is near the hands, where they truly are."""
        self._grip = Grip(self._engine.positions, hands)

    def open_grip(self) -> None:
        """Let go."""
        self._grip = None

    def advance(self, hands_at: HandsAt, until: float) -> None:
        """Step to time `until`, seconds, with the hands truly at `hands_at`.

        Raises:
            SimulationError: the body diverged.
        """
        # Whole steps, counted, so that rounding does not add up.
        while self._steps < round(until / self._step_s):
            hands = hands_at(self.time)
            self._advance_once(hands)
            self._steps += 1
            self.time = self._steps * self._step_s

    def _advance_once(self, hands: Hands) -> None:
        engine = self._engine
        state = StepState(
            time=self.time,
            duration=self._step_s,
            positions=engine.positions,
            velocities=engine.velocities,
            masses=self._masses,
            pressures=engine.table_pressures() if self._needs_pressures else np.zeros(len(self._masses)),
        )
        engine.forces[:] = 0.0
        for term in self._terms:
            term(state, engine.forces)
        if self._grip is not None:
            self._grip.add_forces(
                engine.forces,
                positions=state.positions,
                velocities=state.velocities,
                masses=self._masses,
                hands=hands,
                duration=self._step_s,
                slip=self._slip(),
            )
        if self._pressing:
            before = hands.centres if self._last_centres is None else self._last_centres
            engine.place_balls(hands.centres, (hands.centres - before) / self._step_s)
            self._last_centres = hands.centres
        engine.step()

    def _slip(self) -> np.ndarray | None:
        """[3] m/s at which what is held slides through the hands now, if it does."""
        slip = self.effects.get("grasp_slip")
        if slip is None or self.time < slip["onset"]:
            return None
        return np.array([slip["x"], slip["y"], slip["z"]])

    def _settle(self) -> None:
        """Come to rest, time running up to zero."""
        count = max(self._pressing, 1)
        nowhere = Hands(centres=np.full((count, 3), 10.0), turns=np.zeros(count))
        self._engine.set_damping(SETTLING_DAMPING)
        self._steps = -round(SETTLING / self._step_s)
        self.time = self._steps * self._step_s
        self.advance(lambda _: nowhere, 0.0)
        self._last_centres = None
        self._engine.set_damping(AIR_DAMPING)
        self._engine.stop()


def gravity_with(effects: Effects) -> np.ndarray:
    """[3] m/s^2, as injected effects change it."""
    size = GRAVITY * effects.get("gravity_scale", {"scale": 1.0})["scale"]
    tilt = effects.get("gravity_tilt", {"about_x": 0.0, "about_y": 0.0})
    turn = Rotation.from_rotvec([tilt["about_x"], tilt["about_y"], 0.0])
    return np.asarray(turn.apply([0.0, 0.0, -size]))


def with_added_mass(resting: np.ndarray, masses: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """Masses [V] with a share of their sum added, about a place relative to the centre of the resting body.

    An even ball whose standard deviation along an axis is the radius; the nearest vertex where that is in none. The
    body becomes heavier by it: a twin, of which motion tells forces per mass only, has softer springs instead.
    """
    centre = (resting.min(axis=0) + resting.max(axis=0)) / 2.0
    distances = np.linalg.norm(resting - centre - (values["x"], values["y"], values["z"]), axis=1)
    added = distances <= max(np.sqrt(5.0) * values["radius"], distances.min())
    return masses + added * (values["fraction"] * masses.sum() / added.sum())
