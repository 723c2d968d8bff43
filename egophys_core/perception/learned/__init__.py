"""Adapters to learned models, one file each; docs/learned_models.md says what to get and where to put it.

The rest of the room imports this only where learned models may be asked for, weights are read from paths the user gives
and never downloaded, and torch is imported when a model is loaded.
"""

from egophys_core.perception.learned.cotracker3 import CoTracker3Offline, CoTracker3Online
from egophys_core.perception.learned.grounded_sam2 import GroundedSam2
from egophys_core.perception.learned.loading import load_landmarker, load_stages
from egophys_core.perception.learned.mediapipe_hands import MediapipeHands
from egophys_core.perception.learned.shape_alignment import align_shape
from egophys_core.perception.learned.similarity import Similarity
from egophys_core.perception.learned.trellis import Trellis, complete
from egophys_core.perception.learned.vggt import KnownLength, Vggt
from egophys_core.perception.learned.weights import LearnedModelError

__all__ = [
    "CoTracker3Offline",
    "CoTracker3Online",
    "GroundedSam2",
    "KnownLength",
    "LearnedModelError",
    "MediapipeHands",
    "Similarity",
    "Trellis",
    "Vggt",
    "align_shape",
    "complete",
    "load_landmarker",
    "load_stages",
]
