"""The learned stages that `PerceptionOptions` ask for, from one folder of weights."""

from pathlib import Path

from egophys_core.perception.learned.cotracker3 import CoTracker3Online
from egophys_core.perception.learned.grounded_sam2 import GroundedSam2
from egophys_core.perception.learned.trellis import Trellis
from egophys_core.perception.learned.vggt import Vggt
from egophys_core.perception.learned.weights import PAGE, LearnedModelError
from egophys_core.perception.options import Completion, PerceptionOptions
from egophys_core.perception.staged import StageSet

DETECTOR, SEGMENTER, TRACKER, MAPPER = "grounding-dino", "sam2", "scaled_online.pth", "vggt/model.pt"
COMPLETER = "trellis"
WHAT = {
    DETECTOR: "folder of a Grounding DINO",
    SEGMENTER: "folder of a SAM 2",
    TRACKER: "weights of CoTracker3",
    MAPPER: "weights of VGGT",
    COMPLETER: "folder of TRELLIS-image-large",
}
"""What must be where in the folder of weights; links do."""


def load_stages(options: PerceptionOptions) -> StageSet:
    """Load every learned stage; nothing is downloaded.

    Raises:
        LearnedModelError: the folder lacks something, which is named, or a package is missing, or files do not fit.
    """
    folder, device = Path(options.weights), str(options.device)
    generates = options.completion == Completion.GENERATED
    if not folder.is_dir():
        raise LearnedModelError(f"weights {folder}: no such folder; {PAGE} says what belongs into it")
    wanted = [name for name in WHAT if generates or name != COMPLETER]
    if missing := [f"{name} ({WHAT[name]})" for name in wanted if not (folder / name).exists()]:
        raise LearnedModelError(f"weights {folder}: lacks {', '.join(missing)}; {PAGE} says where they come from")
    return StageSet(
        segmenter=GroundedSam2(
            folder / DETECTOR, folder / SEGMENTER, object_prompt=options.object_prompt, device=device
        ),
        tracker=CoTracker3Online.load(folder / TRACKER, device=device),
        point_mapper=Vggt.load(folder / MAPPER, device=device),
        completer=Trellis.load(folder / COMPLETER, device=device) if generates else None,
    )
