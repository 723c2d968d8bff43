"""The family of motions an experiment is chosen from, within what a person or an arm can do."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.experiments.hand_path import PathWriter, ToolPath
from egophys_core.experiments.places import DEPTH_M, axes_at_rest, distance_to, extents, places_to_hold
from egophys_core.kinds import kind_of
from egophys_core.robot import MotionLimits
from egophys_core.twin import Twin

LONGEST_S = 12.0
"""Seconds of a motion, at most; about two of them pass before hands move."""

CLEARANCE_M = 0.04
"""Metres above the table at which the lowest part of what hangs stays."""

FREQUENCIES_HZ = (0.8, 1.5, 2.2)
"""At which it is swung."""

SWUNG_S = 2.5
"""Seconds for which it is swung, about."""

WIDEST_SWING_M = 0.1
"""Metres to either side."""

LEAST_SWING_M = 0.01
"""Metres: a smaller swing, for want of speed, shows nothing."""

GENTLE = 0.6
"""Of the fastest that is allowed: how fast hands lift and carry."""

SLOW_M_S = 0.04
"""At which it is dragged slowly."""

LETS_GO_S = 0.2
"""Seconds that a hand, or the gripper of an arm, takes to let go."""

TURNED_RAD = 0.8
"""To either side, by which a wrist turns: two of them in the time that there is."""


@dataclass(frozen=True, kw_only=True)
class HandLimits:
    """What hands can do."""

    hands: int
    """1 or 2."""
    fastest_m_s: float
    fastest_turn_rad_s: float
    """Of a wrist."""
    highest_m: float
    """Of a hand above the table."""
    arm: MotionLimits | None = None
    """What plans of an arm are held against; None for hands that follow no plan."""


PERSON = HandLimits(hands=2, fastest_m_s=1.2, fastest_turn_rad_s=3.0, highest_m=0.6)
"""A person at a table."""


def arm_hands(limits: MotionLimits) -> HandLimits:
    """What an arm can do within its limits."""
    return HandLimits(
        hands=1,
        fastest_m_s=limits.max_speed_m_s,
        fastest_turn_rad_s=limits.max_angular_speed_rad_s,
        highest_m=limits.workspace_max_m[2],
        arm=limits,
    )


@dataclass(frozen=True, kw_only=True)
class HandMotion:
    """One motion of the family."""

    name: str
    """What is done, and how: unique in a family."""
    sentence: str
    """For a person who does it."""
    paths: tuple[ToolPath, ...]
    """Of each hand; of equal times."""
    hand_points: np.ndarray
    """[C, 3] metres from the path of a hand to points of it: what is near these is held."""

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.paths[0].times[-1])


HAND_M = 0.02
"""Metres from the middle of a hand to its points."""

HAND_POINTS = HAND_M * np.vstack([np.eye(3), -np.eye(3)])
"""[6, 3] metres."""

ELSEWHERE_M = 0.05
"""Metres from a place where a hand holds to the nearest at which it was held, from which that is another place."""

NO_TABLE_M = 1.0
"""Metres above the table from which an object at rest hangs in hands, and there is none (`observation.hanging`)."""

Write = Callable[[PathWriter, float], None]
"""Writes the path of one hand, of which sign (1 or -1) along the object."""


@dataclass(frozen=True, kw_only=True)
class TableTop:
    """An object at rest on a table, or in a hand, and how far hands may go with it."""

    places: np.ndarray
    """[H, 3] metres, where hands take hold."""
    axes: np.ndarray
    """[2, 3] along and across."""
    size: np.ndarray
    """[3] metres, extents along, across, upwards."""
    lies_flat: bool
    limits: HandLimits
    hand_points: np.ndarray
    """[C, 3] metres about each of these places."""
    hangs: bool = False
    """Whether the hand holds it from the start."""
    elsewhere: bool = False
    """Whether it was held at another place before."""

    @property
    def how(self) -> str:
        """Where it is held, in words."""
        if self.hangs:
            return "it as it was held"
        if self.lies_flat:
            return "its two corners of a long side" if len(self.places) == 2 else "one corner"
        one = "the end at which it was not held before" if self.elsewhere else "one end"
        ends = "both ends" if len(self.places) == 2 else one
        depth = f"{1e3 * DEPTH_M:.0f} mm below the top but no lower than half way"
        return f"{ends} from above, the middle of the hand {depth}"

    @property
    def below(self) -> float:
        """Metres from a hand down to the lowest part of what hangs from it."""
        along, across, up = self.size
        return float(up / 2.0 if not self.lies_flat else across if len(self.places) == 2 else np.hypot(along, across))

    @property
    def highest(self) -> float:
        """Metres by which hands may rise."""
        return float(self.limits.highest_m - self.places[:, 2].max())

    @property
    def hanging(self) -> np.ndarray:
        """[3] metres by which hands rise until the object hangs free, or as far as they may."""
        return np.array([0.0, 0.0, 0.0 if self.hangs else min(self.below + CLEARANCE_M, self.highest)])


def hangs_in_a_hand(twin: Twin) -> bool:
    """Whether an object hangs in a hand from the start of its recordings, far above any table."""
    lowest = float(twin.model.graph.positions[:, 2].min())
    return lowest - twin.ground_height > NO_TABLE_M and len(twin.grasp) > 0


def motions_for(twin: Twin, limits: HandLimits) -> list[HandMotion]:
    """The motions that can be done with an object, with one hand and, where there are two, with both.

    What hangs in a hand from the start of its recordings is moved by that.

    Raises:
        PlanningError: it is of a kind that does not lie on a table, nor hangs in a hand.
    """
    model, found = twin.model, list[HandMotion]()
    tops = []
    if hangs_in_a_hand(twin):
        place = twin.grasp.mean(axis=0, dtype=np.float64)
        tops.append((place[None], twin.grasp - place, limits, True))
    else:
        above = replace(limits, highest_m=limits.highest_m + twin.ground_height)
        for hands in range(1, limits.hands + 1):
            tops.append((places_to_hold(model, hands, twin.grasp), HAND_POINTS, above, False))
    axes, middle = axes_at_rest(model), model.graph.positions.mean(axis=0)
    for places, hand_points, allowed, hangs in tops:
        # Along the object, from its middle to the hand or the first of them.
        sign = -1.0 if (places[0] - middle) @ axes[0] < 0.0 else 1.0
        top = TableTop(
            places=places,
            axes=sign * axes,
            size=extents(model),
            lies_flat=kind_of(model).lies_flat,
            limits=allowed,
            hand_points=hand_points,
            hangs=hangs,
            elsewhere=np.inf > distance_to(twin.grasp, places[0]) > ELSEWHERE_M,
        )
        done = [motion for each in (HANGING if hangs else FAMILY) for motion in each(top)]
        found += [motion for motion in done if motion.duration <= LONGEST_S]
    return found


def _motion(top: TableTop, name: str, sentence: str, write: Write) -> HandMotion:
    """The motion in which every hand goes as written."""
    signs = (1.0, -1.0)[: len(top.places)]
    paths = []
    for place, sign in zip(top.places, signs, strict=True):
        writer = PathWriter(place, holds=top.hangs)
        write(writer, sign)
        paths.append(writer.path())
    hands = "two hands" if len(paths) == 2 else "one hand"
    return HandMotion(
        name=f"{name}, {hands}",
        sentence=f"hold {top.how}; {sentence}",
        paths=tuple(paths),
        hand_points=top.hand_points,
    )


def _centimetres(metres: float) -> str:
    return f"{100 * metres:.0f} cm"


def _lift(up: np.ndarray) -> str:
    return f"lift it by {_centimetres(up[2])}, " if up.any() else ""


def _and_drop(top: TableTop, name: str, sentence: str, write: Write) -> HandMotion:
    """The motion after which every hand lifts it as high as it may, holds it and lets go, if there is a table and time
    for that: a fall costs two seconds, and shows what pulls at the object, and what the air does, beside all the rest.

    A sheet is let go by two hands: from one it hangs in folds, and falls for less long. Of 34 such falls 19
    told nothing (docs/notes/free_fall.md).
    """
    fastest, up = top.limits.fastest_m_s, np.array([0.0, 0.0, top.highest])
    # Where it lies or hangs before is about where it lands.
    falls = np.sqrt(2.0 * max(top.highest - top.below, CLEARANCE_M) / GRAVITY)

    def write_all(hand: PathWriter, sign: float) -> None:
        write(hand, sign)
        hand.move(up, peak_speed=GENTLE * fastest)
        hand.wait(1.0)
        hand.let_go()
        hand.wait(LETS_GO_S + falls)

    lifted = f"lift it to {_centimetres(up[2])} above where it lay, hold it for 1 s and let go of it"
    longer = _motion(top, f"{name} and drop", f"{sentence}; {lifted}", write_all)
    folded = top.lies_flat and len(top.places) == 1
    return _motion(top, name, sentence, write) if top.hangs or folded or longer.duration > LONGEST_S else longer


def hang_and_swing(top: TableTop) -> Iterator[HandMotion]:
    """Hang still, swing out of the plane in which a sheet hangs, hang still, drop."""
    return _swings(top, top.axes[1], "hang and swing", "swing", "across its long side")


def swing_along(top: TableTop) -> Iterator[HandMotion]:
    """Swing what hangs within its plane, and up and down."""
    for axis, how in ((top.axes[0], "sideways within its plane"), (np.array([0.0, 0.0, 1.0]), "up and down")):
        yield from _swings(top, axis, f"swing {how}", "move", how)


def _swings(top: TableTop, axis: np.ndarray, name: str, verb: str, how: str) -> Iterator[HandMotion]:
    """Hang still, go to and fro along an axis [3], hang still; at each frequency at which that is wide enough."""
    fastest, up = top.limits.fastest_m_s, top.hanging
    for frequency in FREQUENCIES_HZ:
        amplitude = min(WIDEST_SWING_M, 0.9 * fastest / (2.0 * np.pi * frequency))
        cycles = max(3, round(SWUNG_S * frequency))
        if amplitude < LEAST_SWING_M:
            continue

        def write(
            hand: PathWriter, _: float, amplitude: float = amplitude, frequency: float = frequency, cycles: int = cycles
        ) -> None:
            hand.move(up, peak_speed=GENTLE * fastest)
            hand.wait(1.5)
            hand.swing(axis, amplitude=amplitude, frequency=frequency, cycles=cycles)
            hand.wait(1.5)

        yield _and_drop(
            top,
            f"{name} at {frequency:g} Hz",
            f"{_lift(up)}let it hang still for 1.5 s, {verb} it {_centimetres(2 * amplitude)} to "
            f"and fro {how}, {cycles} times, {frequency:g} a second, and let it hang still for 1.5 s",
            write,
        )


def hang_still(top: TableTop) -> Iterator[HandMotion]:
    """Lift and wait, drop."""
    fastest, up = top.limits.fastest_m_s, top.hanging

    def write(hand: PathWriter, _: float) -> None:
        hand.move(up, peak_speed=GENTLE * fastest)
        hand.wait(5.0)

    yield _and_drop(top, "hang still", f"{_lift(up)}let it hang still for 5 s", write)


def turn_wrist(top: TableTop) -> Iterator[HandMotion]:
    """Hang still, turn the wrist to and fro about the vertical, hang still."""
    if len(top.places) > 1:
        return
    fastest, up = top.limits.fastest_m_s, top.hanging

    def write(hand: PathWriter, _: float) -> None:
        hand.move(up, peak_speed=GENTLE * fastest)
        hand.wait(1.0)
        for angle in (TURNED_RAD, -TURNED_RAD):
            hand.turn(angle, peak_rate=top.limits.fastest_turn_rad_s)
            hand.wait(0.5)

    yield _motion(
        top,
        "turn the wrist",
        f"{_lift(up)}let it hang still for 1 s, turn it about the vertical by {np.degrees(TURNED_RAD):.0f} degrees to "
        "the left, then by as much to the right of how you took hold of it",
        write,
    )


def drag(top: TableTop) -> Iterator[HandMotion]:
    """Drag over the table, the object behind the hand, and back: slowly once, as fast as is allowed twice."""
    lift = np.array([0.0, 0.0, 0.012 if top.lies_flat else 0.0])
    away = -top.axes[1] if len(top.places) == 2 else top.axes[0]
    fastest = top.limits.fastest_m_s
    for speed, how, length, times in ((SLOW_M_S, "slowly", 0.07, 1), (min(0.4, fastest), "fast", 0.15, 2)):

        def write(hand: PathWriter, _: float, speed: float = speed, length: float = length, times: int = times) -> None:
            hand.move(lift, peak_speed=fastest / 2.0)
            for _ in range(times):
                hand.move(lift + length * away, peak_speed=speed)
                hand.wait(0.3)
                hand.move(lift, peak_speed=speed)
                hand.wait(0.3)

        yield _motion(
            top,
            f"drag {how}",
            f"drag it {_centimetres(length)} over the table, away from its middle, and back{' twice' * (times > 1)}, "
            f"{how} ({_centimetres(speed)}/s at most)",
            write,
        )


def stretch_and_wait(top: TableTop) -> Iterator[HandMotion]:
    """Pull the hands apart, wait, and come back."""
    if len(top.places) < 2:
        return
    apart, fastest = 0.03 * top.size[0], top.limits.fastest_m_s
    lift = np.array([0.0, 0.0, 0.03])

    def write(hand: PathWriter, sign: float) -> None:
        hand.move(lift, peak_speed=fastest / 2.0)
        hand.move(lift + sign * apart * top.axes[0], peak_speed=fastest / 4.0)
        hand.wait(2.5)
        hand.move(lift, peak_speed=fastest / 4.0)
        hand.wait(2.0)

    yield _motion(
        top,
        "stretch and wait",
        f"lift it a little, pull your hands {100 * 2 * apart:.1f} cm apart, wait for 2.5 s, come back and wait for 2 s",
        write,
    )


def press_and_wait(top: TableTop) -> Iterator[HandMotion]:
    """Press a solid down from where it is held, wait, and come back."""
    if top.lies_flat:
        return
    depth, fastest = 0.25 * top.size[2], top.limits.fastest_m_s

    def write(hand: PathWriter, _: float) -> None:
        hand.move([0.0, 0.0, -depth], peak_speed=fastest / 4.0)
        hand.wait(2.5)
        hand.move([0.0, 0.0, 0.0], peak_speed=fastest / 4.0)
        hand.wait(2.0)

    yield _motion(
        top,
        "press and wait",
        f"press it {100 * depth:.1f} cm down, wait for 2.5 s, come back up and wait for 2 s",
        write,
    )


FAMILY: Sequence[Callable[[TableTop], Iterator[HandMotion]]] = (
    hang_and_swing,
    hang_still,
    turn_wrist,
    drag,
    stretch_and_wait,
    press_and_wait,
)
"""What can be done with what lies on a table; add a motion here."""

HANGING: Sequence[Callable[[TableTop], Iterator[HandMotion]]] = (hang_and_swing, hang_still, turn_wrist, swing_along)
"""What can be done with what hangs in a hand."""
