"""All thresholds of the verdict, each with what it means and on what data it was calibrated.

Where nothing else is said, the data are the synthetic sets of the rehearsal world without an effect and the recorded
cases of the project's users (docs/notes/discrepancy.md): so the recorded cases were seen while these were chosen. Gains
are in log-likelihood, on data that were left out.
"""

from dataclasses import dataclass, replace
from typing import Self

from egophys_core.diagnosis.null_gains import RECORDED, NullGains

NOISE_SHARE = 0.5
"""Of what points near hands miss of a step of these (`ObservedEpisode.noise`), what is left in the mean of a block. It
is much, as all points of a frame that is stamped wrongly are off together."""

ACCELERATION_SHARE = 0.08
"""Of what an observer would leave of all acceleration (`acceleration` of residuals), what a twin that lacks nothing may
leave: 0.062 in a rehearsed sheet that was swung by its corners at 0.8 and 2.2 Hz, which left 3.1 mm."""


UNVALIDATED = 20
"""One in so many sets that lack nothing has an effect that gains `unvalidated_gain`. Half of them are refuted by
another criterion at least: of 13 such sets in which something gained 60 or more it passed all others in 6, of which 4
were asked beside other twins, and 3 refuted there. So one in 40 may be named falsely."""

IN_TURN = 6
"""One in so many has one that gains `in_turn_gain`; few of these gain it in each motion."""

STRUCTURED = 8
"""One in so many may be said to have structure."""


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """What a candidate must reach to be named; the defaults are those of the project."""

    least_gain: float = 50.0
    """Gain that an effect needs if it stands alone."""
    crowded_gain: float = 60.0
    """Gain that it needs beside others of more than `crowd_share` of its gain: several soak up a mismatch alike."""
    crowd_share: float = 0.5
    """Share of an effect's gain from which another, which is no confounder of it and not refuted, is one of these."""
    unpenalised_parameters: int = 2
    """Parameters that cost nothing: a direction in the plane, or a size and a rate, soak up little of a mismatch."""
    parameter_gain: float = 5.0
    """Complexity penalty of each further parameter; a gust, with seven, gained 80 in a rehearsed towel without any
    effect that was pulled over the table."""
    second_gain: float = 80.0
    """Gain that an effect, or structure, needs beside a named one; a toy whose added mass was named asked for a tether
    with 79."""
    second_share: float = 0.3
    """Share of the gain of an effect that a search named, below which a second one may be what the first is inexact in.
    In two sheets with drag alone a tether and a friction that differs by place gained 0.24 and 0.15 of it."""
    predicting_share: float = 1.0
    """Of the track errors of free rollouts, geometric mean over what was given: a second effect has to leave less; on
    no data."""
    unvalidated_gain: float = RECORDED.gain_of(1.0 / UNVALIDATED)
    """Gain that an effect needs without a validation episode that would show it: 123, and 180 where motions were asked
    for. With 90 a force was named with 108 in a sheet that lacked nothing, after two motions of its own asking; drags
    and gravities that were there gained 323 to 769."""
    episodes_in_turn: int = 3
    """Fitted motions, each of which gains when it is left out as a whole, from which `in_turn_gain` is enough; as many
    as the recorded toy `plush_lump` has."""
    in_turn_gain: float = RECORDED.gain_of(1.0 / IN_TURN)
    """Gain that is then needed in place of `unvalidated_gain`: 73, and 108 where motions were asked for. The added mass
    of `plush_lump` gained 100, a false tracking offset in `towel_drag` 78 without gaining in each."""
    remaining_share: float = 0.2
    """Share of an effect's gain that must remain where each episode is left out as a whole."""
    harm_share: float = 0.2
    """Share of an effect's gain that one left-out episode may lose before it refutes the effect."""
    others_share: float = 0.5
    """Share of an effect's gain that it must gain beside each of two other twins of the object. Injected drags, tethers
    and added masses gained 0.8 to 1.5 of it; of seven that were not there three gained 0.4 and less."""
    largest_p: float = 0.05
    """Share of surrogates that may gain as much: the usual level, on no data."""
    supported_share: float = 0.1
    """Share of an effect's gain that it must exceed in validation episodes; a rehearsed tether that pulled in two
    motions was slack for the most part of the third."""
    supporting_gain: float = 15.0
    """Gain in validation episodes that is enough in any case; the same tether gained 38 there, false ones 5 or less."""
    overwhelming_gain: float = 180.0
    """Gain from which validation episodes refute an effect only if it loses `supporting_gain` there: a gravity of 0.6
    (found: 0.62) that gained 647 in swings gained 3 in a pull over the table. The largest false gain is 172."""
    validation_share: float = 0.5
    """Share of an effect's gain by which validation episodes may raise or lower its penalised gain; of an injected
    drag, a tether and rough places, which gained 69, 70 and 73, they gained 34, 2 and 14."""
    equal_share: float = 0.9
    """Share of the best one's penalised gain from which an effect is not told apart from it."""
    rival_share: float = 0.75
    """Share from which it is not told apart if the difference, over blocks of time, may be chance."""
    special_case_share: float = 0.4
    """Share of a general effect's gain from which its special case takes its place if it predicts more of validation
    episodes."""
    floor_m: float = 0.002
    """Metres, median residual from which a twin lacks something, whatever it is, where points have little noise;
    rehearsed sets without an effect left 0.5 to 1.3 mm, a sheet under a changing force 3.2."""
    left_share: float = 0.7
    """Share of the residuals of free rollouts that an effect may leave where they exceed `floor_m`; a recorded cable
    on a thread was said to feel a steady force, which left 33 mm of 38."""
    structure_gain: float = RECORDED.gain_of(1.0 / STRUCTURED)
    """Gain of a generic law, or of an effect that is not named, from which a residual is structured: one in
    `STRUCTURED` sets that lack nothing gains as much, 85; 125 where motions were asked for. With 70 it was said there
    of five of ten sets that lack nothing."""
    refit_gain: float = 50.0 / 6.0
    """Gain by slopes or large-amplitude probes below which no refit has found an injected effect."""
    measured_gain: float = 12.0
    """Gain from which an effect that is measured directly shows; in 68 rehearsed and 13 recorded cases without it, it
    gains 2 at most, small injected ones 21 and more."""

    def gain_alone(self, *, fitted: int, validated: bool) -> float:
        """Gain that an effect needs which nothing else rivals, told by so many fitted motions.

        Args:
            validated: whether an episode that is not fitted speaks for it, too.
        """
        if validated:
            return self.least_gain
        return self.in_turn_gain if fitted >= self.episodes_in_turn else self.unvalidated_gain

    def beside(self, gain: float) -> Self:
        """Those beside an effect that a search named and that gains so much."""
        return replace(self, second_gain=max(self.second_gain, self.second_share * gain))


def thresholds_for(noise: float, acceleration: float, null: NullGains) -> Thresholds:
    """Those for recordings of a noise, metres, and of motions that an observer would leave so much of, metres.

    Args:
        null: what the best effect gains in such recordings where nothing is lacking.
    """
    floor = max(Thresholds().floor_m, NOISE_SHARE * noise, ACCELERATION_SHARE * acceleration)
    return replace(
        Thresholds(),
        floor_m=floor,
        unvalidated_gain=null.gain_of(1.0 / UNVALIDATED),
        in_turn_gain=null.gain_of(1.0 / IN_TURN),
        structure_gain=null.gain_of(1.0 / STRUCTURED),
    )
