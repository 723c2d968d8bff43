"""Hands: where they grip or press, from what they move."""
