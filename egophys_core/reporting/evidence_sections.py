"""What the report says of the evidence: what each effect gains, and where the residual lives."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from egophys_core.reporting.diagnosis_words import figures, finite, millimetres
from egophys_core.reporting.html_page import Picture, Table, bold
from egophys_core.reporting.marks import AFTER, BEFORE, QUIET, Scale, bar
from egophys_core.reporting.residual_figure import draw_residual

SHORT_BAR = 0.12
"""How far bars of negative gain may reach to the left, over the largest gain; longer ones are cut."""


def evidence_for_each(content: Mapping[str, Any], mismatch_gain: float) -> dict[str, Any]:
    """What every effect of the library gains, against what is gained without any.

    Args:
        content: of `diagnosis.json`.
        mismatch_gain: held-out gain that is reached in few sets that lack nothing.
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
            bold(name) if name in named else name,
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
    return {
        "mismatch_gain": figures(mismatch_gain),
        "table": Table(
            header=("effect", "held-out gain", "gain", "p", "validation"),
            rows=[row(each) for each in candidates],
            kinds=("", "wide", "", "", ""),
        ),
        "details": Table(
            header=("effect", "fitted gain", "parameters, SI units"), rows=details, kinds=("", "", "text")
        ),
    }


def where_it_lives(where: Mapping[str, Any], rest: np.ndarray, field: np.ndarray) -> dict[str, Any]:
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
    picture = Picture(
        png=draw_residual(rest, field),
        caption="Mean residual on the object",
        says="The object at rest from above and from the side, coloured by the size of the residual, with arrows",
    )
    return {
        "picture": picture,
        "table": Table(header=("where", "residual", "mm"), rows=rows, kinds=("", "wide", "")),
        "worst": ", ".join(f"{name} at {figures(time)} s" for name, time in where["worst_time_s"].items()),
        "law": where["law"],
    }
