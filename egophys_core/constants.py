"""Constants of the world that all rooms agree on."""

GRAVITY = 9.81
"""m/s^2, downward."""

SMALLEST_OBJECT_M, LARGEST_OBJECT_M = 0.01, 5.0
"""Metres across: what hands handle on a table lies well between, in millimetres or kilometres it does not."""
