"""Experiments: which motion of the hands would tell what recordings so far could not."""

from egophys_core.experiments.asking import Asked, Conclusion, diagnose_and_ask, next_motion
from egophys_core.experiments.choice import Proposal, choose
from egophys_core.experiments.family import PERSON, HandLimits, HandMotion, arm_hands, motions_for
from egophys_core.experiments.files import save_experiment

__all__ = [
    "PERSON",
    "Asked",
    "Conclusion",
    "HandLimits",
    "HandMotion",
    "Proposal",
    "arm_hands",
    "choose",
    "diagnose_and_ask",
    "motions_for",
    "next_motion",
    "save_experiment",
]
