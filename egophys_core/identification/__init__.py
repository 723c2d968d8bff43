"""From observed episodes to a twin."""

from egophys_core.identification.build import (
    Progress,
    build_twin,
    episode_digest,
    evaluate_twin,
    first_grasp,
    predict,
)
from egophys_core.identification.contact import Contact, Hand, contact_flags, find_hands
from egophys_core.identification.options import FitOptions, KindChoice
from egophys_core.identification.placing import observed_contacts, place_twin
from egophys_core.identification.problem import FitProblem, prepare

__all__ = [
    "Contact",
    "FitOptions",
    "FitProblem",
    "Hand",
    "KindChoice",
    "Progress",
    "build_twin",
    "contact_flags",
    "episode_digest",
    "evaluate_twin",
    "find_hands",
    "first_grasp",
    "observed_contacts",
    "place_twin",
    "predict",
    "prepare",
]
