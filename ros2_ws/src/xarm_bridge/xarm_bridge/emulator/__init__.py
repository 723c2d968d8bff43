"""xArm6 controller emulator: speaks the real SDK's wire protocol on loopback. Needs no ROS and no SDK."""

import os

# OpenBLAS's idle threads spin after each small matrix: on two cores clients then waited up to 50 ms for an answer.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
