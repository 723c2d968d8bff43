"""Masks from text: Grounding DINO finds object and hands, SAM 2 follows them (the paper, Appendix B.1).

Liu et al., "Grounding DINO", ECCV 2024; Ravi et al., "SAM 2: Segment Anything in Images and Videos", 2024. Both through
`transformers`.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.learned.weights import (
    INSTALL_TORCH,
    from_folder,
    processor_from_folder,
    require_folder,
    require_module,
    rgb,
    to_device,
)
from egophys_core.perception.stages import Masks, View

OBJECT_ID = 1
MOST_HANDS = 2
HAND_EVERY = 10
"""Until a hand is found, every how many-th view it is looked for: hands often come in later."""
SAME_BOX = 0.5
"""Boxes that share more of their union than this are of one hand."""
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


class GroundedSam2:
    """A `Segmenter` that is told in words what to look for. Memory does not grow with the length of the video."""

    def __init__(
        self,
        detector: Path | str,
        tracker: Path | str,
        *,
        object_prompt: str,
        hand_prompt: str = "hand",
        threshold: float = 0.35,
        device: str = "cpu",
    ) -> None:
        """Load both models; nothing is downloaded.

        Args:
            detector: folder of a Grounding DINO (`IDEA-Research/grounding-dino-tiny` or `-base`).
            tracker: folder of a SAM 2 (`facebook/sam2.1-hiera-tiny` to `-large`).
            object_prompt: what the object is, "a towel".
            hand_prompt: what moves it.
            threshold: lowest score of a box that is used, 0..1.
            device: `cpu` or `cuda`.

        Raises:
            LearnedModelError: transformers, a folder or a file in it is missing or does not fit.
        """
        transformers = require_module("transformers", INSTALL_TORCH)
        self._torch = require_module("torch", INSTALL_TORCH)
        detector = require_folder(detector, "a Grounding DINO", ("grounding-dino",))
        tracker = require_folder(tracker, "a SAM 2", ("sam2_video", "sam2"))
        self._detector = from_folder(transformers.GroundingDinoForObjectDetection, detector, device)
        self._processor = processor_from_folder(transformers.AutoProcessor, detector)
        self._tracker = from_folder(transformers.Sam2VideoModel, tracker, device)
        self._new_session = transformers.Sam2VideoInferenceSession
        self._object_prompt = object_prompt
        self._hand_prompt = hand_prompt
        self._threshold = threshold
        self._device = device

    def masks(self, views: Iterable[View]) -> Iterator[Masks]:
        """Masks of each view. A pixel that both claim is of the one with the higher logit.

        The object is the best box of the first view. Hands, at most two, are looked for in the first view and, until
        one is found, in every tenth; before that their mask is empty.

        Raises:
            EpisodeError: the object is not found in the first view.
        """
        session = None
        has_hand = False
        for index, view in enumerate(views):
            size = view.image.shape[:2]
            new: dict[int, np.ndarray] = {}
            if session is None:
                session = self._new_session(
                    video_height=size[0], video_width=size[1], inference_device=self._device, dtype=self._torch.float32
                )
                new[OBJECT_ID] = self._object_box(view)
            if not has_hand and index % HAND_EVERY == 0:
                hands = self._hand_boxes(view)
                has_hand = bool(hands)
                new |= {OBJECT_ID + 1 + number: box for number, box in enumerate(hands)}
            logits = self._follow(session, index, view.image, new)
            yield disjoint(logits[OBJECT_ID], [logit for each, logit in logits.items() if each != OBJECT_ID])

    def boxes(self, image: np.ndarray, prompt: str) -> tuple[np.ndarray, np.ndarray]:
        """All boxes that Grounding DINO proposes for a prompt, the best first.

        Args:
            image: [H, W, 3] uint8 BGR.
            prompt: one kind of thing, "a towel".

        Returns:
            [Q, 4] left, top, right, bottom in pixels, and [Q] scores 0..1.
        """
        text = prompt.strip().lower().rstrip(".") + "."  # as it was trained; other spellings are found less well
        inputs = to_device(self._processor(images=rgb(image), text=text, return_tensors="pt"), self._device)
        with self._torch.no_grad():
            outputs = self._detector(**inputs)
        scores = outputs.logits[0].sigmoid().amax(dim=-1).float().cpu().numpy()
        centre, extent = np.split(outputs.pred_boxes[0].float().cpu().numpy(), 2, axis=1)
        height, width = image.shape[:2]
        corners = np.concatenate([centre - extent / 2, centre + extent / 2], axis=1) * [width, height, width, height]
        order = np.argsort(-scores, kind="stable")
        return np.clip(corners, 0, [width, height, width, height])[order], scores[order]

    def _object_box(self, view: View) -> np.ndarray:
        boxes, scores = self.boxes(view.image, self._object_prompt)
        if scores[0] < self._threshold:
            raise EpisodeError(
                f"nothing is found for the prompt {self._object_prompt!r} in the first view: best score "
                f"{scores[0]:.2f}, threshold {self._threshold:.2f}; name the object otherwise or lower the threshold"
            )
        best: np.ndarray = boxes[0]
        return best

    def _hand_boxes(self, view: View) -> list[np.ndarray]:
        boxes, scores = self.boxes(view.image, self._hand_prompt)
        hands: list[np.ndarray] = []
        for box in boxes[scores >= self._threshold]:
            if len(hands) < MOST_HANDS and all(overlap(box, other) <= SAME_BOX for other in hands):
                hands.append(box)
        return hands

    def _follow(self, session: Any, index: int, image: np.ndarray, new: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
        """Logits [H, W] by id of everything followed, in one more view with boxes of what is new in it."""
        torch = self._torch
        height, width = image.shape[:2]
        side = self._tracker.config.image_size
        # What Sam2VideoProcessor does, without torchvision, which it needs.
        for each, box in new.items():
            corners = torch.tensor(box.reshape(1, 1, 2, 2) * [side / width, side / height], dtype=torch.float32)
            labels = torch.tensor([[[2, 3]]], dtype=torch.int32)
            session.add_point_inputs(
                session.obj_id_to_idx(each), index, {"point_coords": corners, "point_labels": labels}
            )
        session.obj_with_new_inputs = list(new)
        outputs = self._tracker(
            inference_session=session, frame=sam2_pixels(image, side).to(self._device), frame_idx=index
        )
        logits = torch.nn.functional.interpolate(
            outputs.pred_masks.float(), (height, width), mode="bilinear", align_corners=False
        )
        forget(
            session, index, max(self._tracker.config.num_maskmem, self._tracker.config.max_object_pointers_in_encoder)
        )
        return dict(zip(outputs.object_ids, logits[:, 0].cpu().numpy(), strict=True))


def sam2_pixels(image: np.ndarray, side: int) -> Any:
    """[1, 3, side, side] float32 tensor as SAM 2 wants it, of an image [H, W, 3] uint8 BGR."""
    torch = require_module("torch", INSTALL_TORCH)
    pixels = torch.from_numpy(rgb(image)).permute(2, 0, 1)[None].float() / 255
    pixels = torch.nn.functional.interpolate(pixels, (side, side), mode="bilinear", align_corners=False, antialias=True)
    mean, std = (torch.tensor(each).view(1, 3, 1, 1) for each in (IMAGENET_MEAN, IMAGENET_STD))
    return (pixels - mean) / std


def forget(session: Any, index: int, reach: int) -> None:
    """Drop from a SAM 2 session what no later view looks at: all pixels, and what is more than `reach` views old."""
    session.processed_frames.clear()
    for outputs in session.output_dict_per_obj.values():
        followed = outputs["non_cond_frame_outputs"]
        for old in [each for each in followed if each <= index - reach]:
            del followed[old]


def disjoint(object_logit: np.ndarray, hand_logits: list[np.ndarray]) -> Masks:
    """Masks of logits [H, W], above 0 where shown; the higher one has the pixel, the object where they are equal."""
    hand = np.max(hand_logits, axis=0) if hand_logits else np.full_like(object_logit, -np.inf)
    return Masks(object=(object_logit > 0) & (object_logit >= hand), hand=(hand > 0) & (hand > object_logit))


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Shared area over the area of the union of two boxes (left, top, right, bottom); 0 if both are empty."""
    shared = np.clip(np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2]), 0, None).prod()
    union = (one[2:] - one[:2]).prod() + (other[2:] - other[:2]).prod() - shared
    return float(shared / union) if union > 0 else 0.0
