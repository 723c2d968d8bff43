"""Builds a physical twin and rolls it out (twin_node); records topics to MCAP (recorder_node)."""
