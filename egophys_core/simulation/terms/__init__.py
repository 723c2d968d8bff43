"""The force terms of a substep, one file each."""
