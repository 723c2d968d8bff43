"""Constants of the world that all rooms agree on."""

GRAVITY = 9.81
"""m/s^2, downward."""
