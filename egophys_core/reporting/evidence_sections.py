"""Sections of the report that hold the evidence: what each effect gains, and where the residual lives."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from egophys_core.reporting.diagnosis_words import figures, finite, millimetres
from egophys_core.reporting.html_page import Markup, element, picture, table
from egophys_core.reporting.marks import AFTER, BEFORE, QUIET, Scale, bar
from egophys_core.reporting.residual_figure import draw_residual

SHORT_BAR = 0.12
"""How far bars of negative gain may reach to the left, over the largest gain; longer ones are cut."""


def evidence_for_each(content: Mapping[str, Any], mismatch_gain: float) -> list[Markup]:
    """What every effect of the library gains, against what is gained without any.

    Args:
        content: of `diagnosis.json`.
        mismatch_gain: held-out gain that the twin's own mismatch reaches.
    """
    candidates = content["candidates"]
    gains = [each["held_out_gain"] for each in candidates if finite(each["held_out_gain"])]
    highest = max([*gains, 1.2 * mismatch_gain])
    scale = Scale(low=max(min([*gains, 0.0]), -SHORT_BAR * highest), high=highest)
    named = {each["name"] for each in content["effects"]}

    def row(each: Mapping[str, Any]) -> list[object]:
        gain, name = each["held_out_gain"], each["name"]
        mark = bar(
            gain if finite(gain) else 0.0,
            scale,
            colour=AFTER if name in named else QUIET,
            band=(0.0, mismatch_gain),
        )
        return [
            element("b", name) if name in named else name,
            Markup(mark),
            figures(gain),
            figures(each["p_null"]),
            figures(each["validation_gain"]),
        ]

    details = [
        [
            each["name"],
            figures(each["fitted_gain"]),
            ", ".join(f"{name} {figures(value)}" for name, value in each["values"].items()),
        ]
        for each in candidates
    ]
    return [
        element("h2", "Evidence for each effect of the library"),
        element(
            "p",
            "Bars: how much better the twin with the effect explains data it was not fitted to (gain in "
            "log-likelihood); bars of loss are cut short. Grey ground: what a twin's own mismatch gains without an "
            f"effect, {figures(mismatch_gain)} at most. p: share of surrogates, effects shifted in time, that gain as "
            "much; an effect needs 0.05 or less. Validation: gain in the episodes that took no part in the fit.",
            class_="quiet",
        ),
        table(
            ("effect", "held-out gain", "gain", "p", "validation"),
            [row(each) for each in candidates],
            kinds=("", "wide", "", "", ""),
        ),
        element(
            "details",
            element("summary", "Fitted gain and parameters of each"),
            table(("effect", "fitted gain", "parameters, SI units"), details, kinds=("", "", "text")),
        ),
    ]


def where_it_lives(where: Mapping[str, Any], rest: np.ndarray, field: np.ndarray) -> list[Markup]:
    """On which part of the object, when and in what motion the twin is off.

    Args:
        where: of `diagnosis.json`.
        rest: [P, 3] metres, tracks at rest.
        field: [P, 3] metres, their mean residual.
    """
    sizes = {**where["by_region"], **where["by_motion"]}
    known = [size for size in sizes.values() if finite(size)]
    scale = Scale(low=0.0, high=max([*known, 1e-6]))
    rows = [
        [name, Markup(bar(size, scale, colour=BEFORE)) if finite(size) else "", millimetres(size)]
        for name, size in sizes.items()
    ]
    parts = [
        element("h2", "Where the residual lives"),
        element(
            "p",
            "The residual before any effect: measured minus predicted, by a twin that is kept near what was measured.",
            class_="quiet",
        ),
        picture(
            draw_residual(rest, field),
            caption="Mean residual on the object",
            says="The object at rest from above and from the side, coloured by the size of the residual, with arrows",
        ),
        table(("where", "residual", "mm"), rows, kinds=("", "wide", "")),
    ]
    worst = ", ".join(f"{name} at {figures(time)} s" for name, time in where["worst_time_s"].items())
    if worst:
        parts.append(element("p", f"It is largest in {worst}."))
    if where["law"]:
        parts.append(
            element(
                "p", "The best simple force law, whatever its cause (acceleration): ", element("code", where["law"])
            )
        )
    return parts
