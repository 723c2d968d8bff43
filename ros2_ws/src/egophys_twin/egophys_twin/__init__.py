"""Builds, rolls out and diagnoses a twin (twin_node); watches the object (observer_node); records (recorder_node)."""
