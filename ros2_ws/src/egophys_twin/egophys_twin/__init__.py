"""Builds a twin and rolls it out (twin_node); watches the object (observer_node); records (recorder_node)."""
