"""Replaying a log: its inputs go through the same code again and the outputs are compared, bit for bit."""

from egophys_core.replay.difference import Difference
from egophys_core.replay.replay import Replay, replay_log
from egophys_core.replay.steps import Comparison, ReplayOutcome

__all__ = ["Comparison", "Difference", "Replay", "ReplayOutcome", "replay_log"]
