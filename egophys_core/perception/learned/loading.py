"""The learned stages and the landmarks of hands that `PerceptionOptions` ask for, from one folder of weights."""

from pathlib import Path

from egophys_core.perception.learned.cotracker3 import CoTracker3Online
from egophys_core.perception.learned.grounded_sam2 import GroundedSam2
from egophys_core.perception.learned.mediapipe_hands import PALM_FILE, POSE_FILE, MediapipeHands
from egophys_core.perception.learned.trellis import Trellis
from egophys_core.perception.learned.vggt import Vggt
from egophys_core.perception.learned.weights import PAGE, LearnedModelError
from egophys_core.perception.options import Completion, HandCue, PerceptionOptions
from egophys_core.perception.staged import StageSet
from egophys_core.perception.stages import HandLandmarker

DETECTOR, SEGMENTER, TRACKER, MAPPER = "grounding-dino", "sam2", "scaled_online.pth", "vggt/model.pt"
COMPLETER = "trellis"
WHAT = {
    DETECTOR: "folder of a Grounding DINO",
    SEGMENTER: "folder of a SAM 2",
    TRACKER: "weights of CoTracker3",
    MAPPER: "weights of VGGT",
    COMPLETER: "folder of TRELLIS-image-large",
    PALM_FILE: "palm detection of MediaPipe Hands",
    POSE_FILE: "hand pose estimation of MediaPipe Hands",
}
"""What must be where in the folder of weights; links do."""


def load_stages(options: PerceptionOptions) -> StageSet:
    """Load every learned stage; nothing is downloaded.

    Raises:
        LearnedModelError: the folder lacks something, which is named, or a package is missing, or files do not fit.
    """
    device = str(options.device)
    generates = options.completion == Completion.GENERATED
    folder = _folder_with(options, DETECTOR, SEGMENTER, TRACKER, MAPPER, *([COMPLETER] if generates else []))
    return StageSet(
        segmenter=GroundedSam2(
            folder / DETECTOR, folder / SEGMENTER, object_prompt=options.object_prompt, device=device
        ),
        tracker=CoTracker3Online.load(folder / TRACKER, device=device),
        point_mapper=Vggt.load(folder / MAPPER, device=device),
        completer=Trellis.load(folder / COMPLETER, device=device) if generates else None,
    )


def load_landmarker(options: PerceptionOptions) -> HandLandmarker | None:
    """Load what finds landmarks of hands, None if none are asked for; nothing is downloaded.

    Raises:
        LearnedModelError: the folder lacks a model, which is named, or files do not fit.
    """
    if options.hands != HandCue.MEDIAPIPE:
        return None
    return MediapipeHands.load(_folder_with(options, PALM_FILE, POSE_FILE))


def _folder_with(options: PerceptionOptions, *wanted: str) -> Path:
    """The folder of weights, in which all of this is."""
    folder = Path(options.weights)
    if not folder.is_dir():
        raise LearnedModelError(f"weights {folder}: no such folder; {PAGE} says what belongs into it")
    if missing := [f"{name} ({WHAT[name]})" for name in wanted if not (folder / name).exists()]:
        raise LearnedModelError(f"weights {folder}: lacks {', '.join(missing)}; {PAGE} says where they come from")
    return folder
