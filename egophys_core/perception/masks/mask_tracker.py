"""Follow the object and the hand from view to view by colour, by what the table looks like and by where both were."""

import cv2
import numpy as np

from egophys_core.errors import EpisodeError
from egophys_core.perception.masks.colour_model import (
    ColourModel,
    colour_codes,
    is_black,
    log_features,
    with_gain_removed,
)
from egophys_core.perception.masks.table_background import (
    ExpectedTable,
    TableBackground,
    has_pose,
    table_homography,
    table_log_likelihood,
    table_places,
)
from egophys_core.perception.masks.texture_model import TextureModel, texture_codes
from egophys_core.perception.stages import Masks, View

_BESIDE = 12.0
"""Pixels from the hand."""
_TAUGHT = 40.0
"""Pixels from the hand beyond which what looks like the object is learnt as such."""
_SAME_LIGHT = 0.15
"""Change of the logarithm of brightness that is no other light."""
_SMOOTHING = 1.2
"""Pixels over which the log-likelihoods of a label are averaged."""
_NOISE_BLUR = 0.6
"""Pixels; more makes the rim of the object unlike the table and the mask a pixel too wide."""
_DECAY = 2.5
"""Pixels outside a prior over which its log-odds fall by one."""
_FARTHEST = -12.0
_ENTRY = -3.0
"""Log-odds of a hand at a pixel where there was none."""


class MaskTracker:
    """Masks of one view after the other, from the object's mask in the first.

    Each pixel gets the label, of background, object and hand, that is the most likely one by its colour (a histogram
    of each, learnt as it goes; of the table the mean and variance at that place, from a top view) and by where the
    label was in the view before, moved by the optical flow (Kroeger et al., DIS, ECCV 2016).
    """

    def __init__(self, first_view: View, object_mask: np.ndarray, *, table_height: float = 0.0) -> None:
        """Learn the colours of the first view.

        Args:
            first_view: the view of the mask; no hand is seen in it.
            object_mask: [S, S] bool.
            table_height: z of the table, metres.

        Raises:
            EpisodeError: the mask does not fit the view or is empty.
        """
        side = first_view.image.shape[0]
        if object_mask.shape != (side, side) or object_mask.dtype != bool or not object_mask.any():
            raise EpisodeError(
                f"the object's mask must be [{side}, {side}] bool as the view and not empty, got {object_mask.shape} "
                f"{object_mask.dtype} with {np.count_nonzero(object_mask)} pixels"
            )
        self._table_height = table_height
        self._flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._object_colours = ColourModel(shading=0.25, background_share=0.03)
        self._hand_colours = ColourModel(shading=0.15, background_share=0.05)
        self._rest_colours = ColourModel(shading=0.10, background_share=0.01)
        self._object_texture, self._hand_texture, self._rest_texture = TextureModel(), TextureModel(), TextureModel()
        self._table: TableBackground | None = None
        self._area = np.count_nonzero(object_mask)
        self._grey = cv2.cvtColor(first_view.image, cv2.COLOR_BGR2GRAY)
        self._gain = 1.0
        self._pose = first_view
        self._amodal = object_mask.copy()
        self._object = object_mask.copy()
        self._hand = np.zeros_like(object_mask)
        image = cv2.GaussianBlur(first_view.image, (0, 0), _NOISE_BLUR)
        codes, texture = colour_codes(image), texture_codes(image)
        inner = cv2.erode(object_mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        self._object_colours.learn(codes[inner if inner.any() else object_mask])
        self._object_texture.learn(texture[inner if inner.any() else object_mask])
        outer = cv2.dilate(object_mask.astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
        self._rest_colours.learn(codes[outer])
        self._rest_texture.learn(texture[outer])
        self._level = float(np.median(self._grey[outer])) if outer.any() else float(np.median(self._grey))
        if has_pose(first_view):
            y, x = np.nonzero(object_mask)
            centre = table_places(first_view, np.array([[x.mean(), y.mean()]]), table_height)[0]
            if np.isfinite(centre).all():
                features = log_features(image)
                self._table = TableBackground(first_view, centre, features, outer, table_height=table_height)

    def next(self, view: View, object_prior: np.ndarray | None = None) -> Masks:
        """Masks of the next view; both are empty for a black frame, after which the next goes on.

        Args:
            view: the next view in time.
            object_prior: [S, S] bool, where the object should be seen; None to take the last masks along the flow.
        """
        side = len(self._object)
        empty = np.zeros((side, side), bool)
        grey = cv2.cvtColor(view.image, cv2.COLOR_BGR2GRAY)
        if is_black(view):
            return Masks(object=empty, hand=empty.copy())
        amodal, last_hand = self._moved(view, grey)
        if object_prior is not None:
            amodal = object_prior
        expected = self._table.expected(view) if self._table is not None and has_pose(view) else None
        self._gain = self._gain_of(view.image, expected, amodal | last_hand)
        image = with_gain_removed(view.image, self._gain)
        image = cv2.GaussianBlur(image, (0, 0), _NOISE_BLUR)
        codes, features = colour_codes(image), log_features(image)

        texture = texture_codes(image)
        of_object = self._object_colours.log_likelihood(codes) + self._object_texture.log_likelihood(texture)
        of_hand = self._hand_colours.log_likelihood(codes) + self._hand_texture.log_likelihood(texture)
        of_rest = self._rest_colours.log_likelihood(codes)
        is_darker = is_brighter = empty
        if expected is not None:
            same, other = table_log_likelihood(features, expected.mean, expected.variance)
            relit = expected.inside & (other > same)
            darker = features[..., 2] < expected.mean[..., 2]
            is_darker, is_brighter = relit & darker, relit & ~darker
            of_rest = np.where(expected.inside, np.maximum(same, other), of_rest)
        # A shadow has less contrast, which must not make it a hand; but a first hand may come darker than the table.
        rest_texture = self._rest_texture.log_likelihood(texture, is_darker)
        of_rest = of_rest + np.where(is_darker & ~self._hand_colours.known, np.float32(0.0), rest_texture)

        outside_object = _distance_outside(amodal)
        outside_hand = _distance_outside(last_hand)
        inside_object, inside_hand = _distance_outside(~amodal), _distance_outside(~last_hand)
        lost = np.count_nonzero(self._object) < 0.05 * self._area and object_prior is None
        score_object = of_object + np.maximum(-outside_object / _DECAY, -3.0 if lost else _FARTHEST)
        score_hand = of_hand + np.maximum(-outside_hand / _DECAY, _ENTRY)
        score_rest = of_rest - np.maximum(
            np.minimum(inside_object / _DECAY, 4.0), np.minimum(inside_hand / _DECAY, 1.5)
        )
        if expected is not None:
            # Between a hand that comes over the object and table that shows up beside it, the hand is likelier.
            beside = ~expected.seen & (amodal | ~is_darker) & (outside_hand < _BESIDE)
            score_rest = score_rest - beside * np.float32(2.5)
        scores = np.stack([score_rest, score_object, score_hand], axis=-1)
        scores -= scores.max(axis=-1, keepdims=True)
        scores = cv2.GaussianBlur(np.maximum(scores, -6.0), (0, 0), _SMOOTHING)
        label = scores.argmax(axis=-1)
        found, hand = self._cleaned(label, scores, amodal, last_hand, lost)
        hand = _supported(hand, of_hand - of_rest)
        self._learn(view, codes, texture, features, found, hand, is_darker, is_brighter, of_object, of_rest, expected)
        self._grey, self._pose = grey, view
        self._object, self._hand = found, hand
        self._amodal = found | (amodal & hand)
        return Masks(object=found.copy(), hand=hand.copy())

    def go_on_from(self, masks: Masks) -> None:
        """Take better masks of the last view for those that were found in it."""
        self._object, self._hand = masks.object.copy(), masks.hand.copy()
        self._amodal = self._object | (self._amodal & self._hand)

    def _moved(self, view: View, grey: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Last object, with what the hand hid of it, and hand, [S, S] bool each, where the flow takes them."""
        side = len(grey)
        level = float(np.mean(grey)) / max(float(np.mean(self._grey)), 1.0)
        before = np.clip(self._grey * level, 0, 255).astype(np.uint8)
        flow = self._flow.calc(grey, before, None)
        y, x = np.mgrid[:side, :side].astype(np.float32)

        def warp(mask: np.ndarray, by: np.ndarray) -> np.ndarray:
            moved = cv2.remap(mask.astype(np.float32), x + by[..., 0], y + by[..., 1], cv2.INTER_LINEAR)
            return np.asarray(moved > 0.5)

        seen, hand = warp(self._object, flow), warp(self._hand, flow)
        hidden = self._amodal & ~self._object
        if not hidden.any():
            return seen, hand
        if np.count_nonzero(seen) > 30:
            by = np.broadcast_to(np.median(flow[seen], axis=0), flow.shape)
        elif has_pose(view) and has_pose(self._pose):
            # Nothing of the object is seen: it is taken to lie still on the table.
            now, then = (table_homography(each, self._table_height) for each in (view, self._pose))
            back = then @ np.linalg.inv(now)
            by = cv2.perspectiveTransform(np.dstack([x, y]), back) - np.dstack([x, y])
        else:
            by = np.broadcast_to(np.median(flow[~hand], axis=0), flow.shape)
        return seen | warp(hidden, by.astype(np.float32)), hand

    def _gain_of(self, image: np.ndarray, expected: ExpectedTable | None, occupied: np.ndarray) -> float:
        """Brightness of a frame relative to the first."""
        step = 4
        free = ~occupied[::step, ::step]
        if expected is not None:
            free = free & expected.seen[::step, ::step]
        if np.count_nonzero(free) < 50:
            return self._gain
        small = image[::step, ::step]
        if expected is not None:
            ratio = log_features(small[free])[:, 2] - expected.mean[::step, ::step][free][:, 2]
            # A large shadow or hand is no change of exposure while part of the table looks as before.
            as_before = ratio[np.abs(ratio - np.log(self._gain)) < _SAME_LIGHT]
            ratio = as_before if len(as_before) > 0.2 * len(ratio) else ratio
            return float(np.clip(np.exp(np.median(ratio)), 0.1, 10))
        grey = cv2.cvtColor(np.ascontiguousarray(small), cv2.COLOR_BGR2GRAY)
        return float(np.clip(np.median(grey[free]) / max(self._level, 1.0), 0.1, 10))

    def _cleaned(
        self, label: np.ndarray, scores: np.ndarray, amodal: np.ndarray, last_hand: np.ndarray, lost: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        smallest = max(12, self._area // 400)
        # The rim of an object is a mixture of colours like nothing else: a hand is wider than that.
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
        hand = cv2.morphologyEx((label == 2).astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0
        found = (label == 1) | ((label == 2) & ~hand & (scores[..., 1] > scores[..., 0]))
        if not lost:
            # What appears away from the object is a hand, whatever its colour.
            apart = found & ~_meeting(found, cv2.dilate(amodal.astype(np.uint8), kernel) > 0)
            found, hand = found & ~apart, hand | apart
        found = _parts(found, amodal, smallest)
        hand = _parts(hand, last_hand, 5 * smallest)
        found = found | (_holes(found, 4 * smallest) & ~hand)
        hand = hand | (_holes(hand, 4 * smallest) & ~found)
        return found, hand

    def _learn(
        self,
        view: View,
        codes: np.ndarray,
        texture: np.ndarray,
        features: np.ndarray,
        found: np.ndarray,
        hand: np.ndarray,
        is_darker: np.ndarray,
        is_brighter: np.ndarray,
        of_object: np.ndarray,
        of_rest: np.ndarray,
        expected: ExpectedTable | None,
    ) -> None:
        small, large = np.ones((5, 5), np.uint8), np.ones((9, 9), np.uint8)
        # What of a hand is taken for the object must not be learnt as the object: more of it would follow.
        inner = (cv2.erode(found.astype(np.uint8), small) > 0) & (_distance_outside(hand) > _TAUGHT)
        if np.count_nonzero(inner) > 0.2 * self._area:
            self._object_colours.learn(codes[inner], rate=0.03)
            self._object_texture.learn(texture[inner], rate=0.03)
        inner = cv2.erode(hand.astype(np.uint8), small) > 0
        if np.count_nonzero(inner) > 30:
            usual = np.median(of_rest[~found & ~hand])
            self._hand_colours.learn(codes[inner & (of_rest < usual - 4)], rate=0.1)
            self._hand_texture.learn(texture[inner], rate=0.1)
        if self._table is not None and expected is not None:
            near = cv2.dilate((found | hand).astype(np.uint8), large) > 0
            trusted = expected.seen | (_distance_outside(hand) > _BESIDE)
            free = ~near & ~is_darker & (of_rest > of_object + 1) & trusted
            self._table.learn(view, features, free, is_brighter)


def _distance_outside(mask: np.ndarray) -> np.ndarray:
    """[S, S] float32 pixels to the nearest pixel of the mask; very far if it is empty."""
    if not mask.any():
        return np.full(mask.shape, 1e4, np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3))


def _parts(mask: np.ndarray, prior: np.ndarray, smallest: int) -> np.ndarray:
    """Connected parts that are large or meet the prior."""
    labels, stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)[1:3]
    keep = stats[:, cv2.CC_STAT_AREA] >= smallest
    hits = np.bincount(labels[prior], minlength=len(stats)) > 0
    keep |= hits & (stats[:, cv2.CC_STAT_AREA] >= 4)
    keep[0] = False
    return keep[labels]


def _meeting(mask: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Connected parts of a mask that have a pixel in the other."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    keep = np.bincount(labels[other], minlength=count) > 0
    keep[0] = False
    return keep[labels]


def _supported(mask: np.ndarray, evidence: np.ndarray) -> np.ndarray:
    """Connected parts of a mask whose evidence [S, S] is positive on average: the others were only there before."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    keep = np.bincount(labels.ravel(), weights=evidence.ravel(), minlength=count) > 0
    keep[0] = False
    return keep[labels]


def _holes(mask: np.ndarray, largest: int) -> np.ndarray:
    """Connected parts of what is not in the mask that are at most so large, pixels."""
    labels, stats = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)[1:3]
    keep = stats[:, cv2.CC_STAT_AREA] <= largest
    keep[0] = False
    return keep[labels]
