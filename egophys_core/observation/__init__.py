"""How an object is seen in an episode: tracks or markers, who holds it and when, and a twin placed in it."""

from egophys_core.observation.contact import Contact, Hand, contact_flags, find_hands
from egophys_core.observation.placing import observed_contacts, place_twin
from egophys_core.observation.problem import FitProblem, prepare

__all__ = [
    "Contact",
    "FitProblem",
    "Hand",
    "contact_flags",
    "find_hands",
    "observed_contacts",
    "place_twin",
    "prepare",
]
