"""Values: the parameters of an effect by name."""

from collections.abc import Mapping

Values = Mapping[str, float]
"""SI units."""
