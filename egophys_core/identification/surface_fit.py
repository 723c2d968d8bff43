"""From episodes that show an object's surface to its model: the coarse search, then the dense refinement."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from egophys_core.effects import TwinEffect
from egophys_core.errors import OptionsError
from egophys_core.identification.coarse import fit_coarse
from egophys_core.identification.dense import fit_dense
from egophys_core.identification.fit import Fit, Progress
from egophys_core.identification.options import FitOptions, StiffnessOption
from egophys_core.kinds.kind import RestShape, Touch
from egophys_core.kinds.rest_shape import rest_shape
from egophys_core.observation import FitProblem, ObservedEpisode, prepare
from egophys_core.observation.grasp_radius import grasp_radius
from egophys_core.prior import default_codebook, load_codebook, with_prior
from egophys_core.simulation import ContactKind, as_they_were
from egophys_core.twin import Codebook

TOUCHES = {Touch.HELD: ContactKind.HOLD, Touch.PRESSED: ContactKind.PRESS}
"""The contacts in which hands do so."""

SEARCH_SHARE, DENSE_SHARE = 0.6, 0.35
"""Parts of the progress bar that the search and the dense refinement take; without the latter the search has both."""


def fit_surface(
    observed: Sequence[ObservedEpisode],
    options: FitOptions,
    *,
    seed: int,
    progress: Progress,
    checkpoint: Path | None,
) -> Fit:
    """Fit a model to the train frames of episodes; its nodes come from the first, the others are registered.

    The checkpoint of a prior is read before anything is searched.

    Raises:
        EpisodeError: an episode cannot be fitted (no contact, too few points or frames).
        OptionsError: a template is given, or a kind that is not modelled from its surface.
        TwinError: no candidate survived, or the checkpoint is of another build.
        OutputError: the checkpoint cannot be written.
    """
    first = observed[0]
    if options.template:
        raise OptionsError(
            f"template {options.template} is given, and {first.episode.name} shows {first.episode.points.shape[1]} "
            "points of a surface; templates are for records of a few markers: leave it out, or track fewer points"
        )
    codebook = _prior(options)
    shape = shape_to_search(observed, options)
    recorded = [prepare(each, shape.positions, shape.surface, spacing=shape.spacing) for each in observed]
    late = late_points(observed)
    problems = [replace(each, controls=as_they_were(each.controls, late)) for each in recorded]
    refines = options.stiffness is StiffnessOption.DENSE and options.dense_steps > 0
    search_share = SEARCH_SHARE if refines else SEARCH_SHARE + DENSE_SHARE
    coarse = fit_coarse(
        problems,
        shape,
        options,
        seed=seed,
        progress=lambda share, loss: progress("search", search_share * share, loss),
        checkpoint=checkpoint,
    )
    model, unlike = coarse.model, tuple[str, ...]()
    if refines:
        model = fit_dense(
            problems,
            coarse.model,
            options,
            progress=lambda share, loss: progress("refine", SEARCH_SHARE + DENSE_SHARE * share, loss),
        )
    elif codebook is not None:
        model, unlike = with_prior(coarse.model, codebook)
    return Fit(
        model=replace(model, effects=late),
        grasp=first_grasp(recorded[0]),
        problem=recorded[0],
        loss=coarse.loss,
        settings={**options.settings(at_markers=False), **assumed(observed, late, (*coarse.at_bounds, *unlike))},
    )


def shape_to_search(observed: Sequence[ObservedEpisode], options: FitOptions) -> RestShape:
    """The object at rest as the first of some episodes shows it, held as wide as in all of them.

    Raises:
        EpisodeError: it cannot be made of what is seen.
    """
    first = observed[0]
    shape = rest_shape(
        first.at_rest,
        name=first.episode.name,
        ground=first.episode.ground_height,
        max_nodes=options.max_nodes,
        kind=options.named_kind,
    )
    kinds = {contact.kind for each in observed for hand in each.hands for contact in hand.contacts}
    return replace(
        shape,
        grasp_radius=grasp_radius(observed),
        lies=not first.hangs,
        touches=frozenset(touch for touch, kind in TOUCHES.items() if kind in kinds),
    )


def _prior(options: FitOptions) -> Codebook | None:
    """What gives springs their stiffness after the search; None if nothing learned does.

    Raises:
        TwinError: the checkpoint cannot be used.
    """
    if options.stiffness is not StiffnessOption.CODEBOOK:
        return None
    return load_codebook(Path(options.prior)) if options.prior else default_codebook()


def assumed(
    observed: Sequence[ObservedEpisode], late: Sequence[TwinEffect], notes_of_fit: Sequence[str]
) -> dict[str, list[str]]:
    """What was taken to be so without being told, as sentences under one name; nothing where nothing was.

    Args:
        notes_of_fit: which numbers ended at the end of what is searched, and where a prior does not know the object.
    """
    notes = [f"the points are recorded {each.values['delay']:.3f} s later than the hands" for each in late]
    hanging = ", ".join(each.name for each in observed if each.hangs)
    if hanging:
        notes.append(f"there is no table in {hanging}: hands hold the object from the first frame on, far from it")
    notes += notes_of_fit
    return {"assumed": notes} if notes else {}


def late_points(observed: Sequence[ObservedEpisode]) -> tuple[TwinEffect, ...]:
    """That points are recorded later than hands, as an effect that the twin carries; nothing where that is not told.

    Without it every number of the twin would make up for hands that seem to be elsewhere.
    """
    delay = float(np.median([each.delay for each in observed]))
    return (TwinEffect(name="control_delay", values={"delay": delay}),) if delay else ()


def first_grasp(problem: FitProblem) -> np.ndarray:
    """[C, 3] float32 metres, world: a hand's points as it first takes hold, or presses if none ever holds."""
    contacts = [(contact, hand) for hand in problem.hands for contact in hand.contacts]
    contact, hand = min(contacts, key=lambda pair: (pair[0].kind != ContactKind.HOLD, pair[0].first))
    return problem.episode.controllers[contact.first, hand.controllers].astype(np.float32)
