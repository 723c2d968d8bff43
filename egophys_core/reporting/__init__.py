"""Results as pictures, words and pages."""

from egophys_core.reporting.diagnosis_report import diagnosis_html
from egophys_core.reporting.diagnosis_words import EffectText, figures, headline, millimetres
from egophys_core.reporting.limits_section import limits_in_words
from egophys_core.reporting.shape_figure import draw_shapes
from egophys_core.reporting.why_section import decision_in_words, miss_in_words

__all__ = [
    "EffectText",
    "decision_in_words",
    "diagnosis_html",
    "draw_shapes",
    "figures",
    "headline",
    "limits_in_words",
    "millimetres",
    "miss_in_words",
]
