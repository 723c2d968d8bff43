"""Results as pictures, words and pages."""

from egophys_core.reporting.diagnosis_report import diagnosis_html
from egophys_core.reporting.diagnosis_words import EffectText, figures, headline, millimetres
from egophys_core.reporting.shape_figure import draw_shapes

__all__ = ["EffectText", "diagnosis_html", "draw_shapes", "figures", "headline", "millimetres"]
