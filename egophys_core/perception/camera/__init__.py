"""Frames, lens, board, table and camera poses."""
