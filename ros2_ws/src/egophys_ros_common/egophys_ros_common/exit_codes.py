"""What the exit code of a node says; launch files read it."""

ENDED = 0
COULD_NOT_START = 1
"""It was to configure and activate by itself."""
BAD_PARAMETERS = 2
CRASHED = 70
"""Unlike with the two before, it may help to start the node again."""
