"""How long an episode may last."""

LATEST = 60.0
"""Seconds: no episode is longer."""
