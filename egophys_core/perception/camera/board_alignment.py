"""Fit the known print of a board to the pixels of an image: a camera pose far better than from tag corners.

All pixels on the tags count, each by how much the rendered print would change there. The print is rendered through
the homography with the area of each pixel, blurred by one width, and given a gain and an offset per tag, so that
neither blur nor shading moves it. Lucas and Kanade 1981 in the 6 parameters of the pose instead of a shift.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from egophys_core.perception.camera.board import Board
from egophys_core.perception.robust import robust_scale

_TEXELS_PER_CELL = 24
_SUPERSAMPLING = 4
_ITERATIONS = 15
_COARSE = 3
_SETTLED_PIXELS = 0.002
_SETTLED_ENOUGH_PIXELS = 0.05
"""Steps this small that do not end, pixels on and off the robust weights, still are a solution."""
_LARGEST_STEP = 3.0
"""Pixels."""
_START_BLUR = 1.0
_SMALLEST_BLUR = 0.1
_LARGEST_BLUR = 6.0
_TUKEY = 4.685
"""Tukey's biweight rejects residuals beyond this many standard deviations (95 % efficiency on Gaussian noise)."""
_MATCHING_AT_START = 0.3
_MATCHING = 0.75
"""Correlation of a tag's pixels with its rendered print from which on it counts as seen."""

_FEWEST_PIXELS = 300
_SMALLEST_REGION = 20
"""Pixels."""
_LEAST_NOISE = 0.5
"""Grey levels: rounding alone leaves 0.3."""
_FREE = [0, 1, 2, 3, 4, 5, 7]
"""The parameters solved for; the focal length (6) is only watched."""


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """A pose at which the rendered print fits the image best."""

    camera_from_board: np.ndarray
    """[4, 4] float64."""
    covariance: np.ndarray
    """[6, 6] of a small motion in the camera frame: translation, metres, then rotation vector, radians; from the
    residuals as if they were independent between pixels."""
    tags: np.ndarray
    """[K] int: indices of the tags that fit, in order."""
    tag_offsets: np.ndarray
    """[K, 2] pixels by which each tag alone would still be moved."""
    tag_growth: float
    """Share by which the tags, each about its centre, would still grow (median)."""
    blur: float
    """Standard deviation of the blur, pixels."""
    noise: float
    """Standard deviation of the residuals, grey levels."""
    log_focal: tuple[float, float]
    """By what the logarithm of the focal length would still be changed, and the standard deviation of that."""


class BoardPrint:
    """The print of a board, rendered and fitted; holds only what does not change between images."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.margin = board.gap / 2
        """Metres around each tag that belong to it: the white halfway to the next."""

    @cached_property
    def _texture(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Print [h, w] uint8 (0 black, 255 white), tag + 1 of each texel [h, w] uint8, and texel from board [3, 3]."""
        board = self.board
        texels = _TEXELS_PER_CELL * board.cells_per_tag / board.tag_side
        tag_texels = _TEXELS_PER_CELL * board.cells_per_tag
        width, height = (round((extent + 2 * self.margin) * texels) for extent in board.size)
        pattern = np.full((height, width), 255, np.uint8)
        labels = np.zeros((height, width), np.uint8)
        for tag, corner in enumerate(board.tag_corners):
            left, top = (round(float(value + self.margin) * texels) for value in corner)
            block = np.ones((_TEXELS_PER_CELL, _TEXELS_PER_CELL), np.uint8)
            pattern[top : top + tag_texels, left : left + tag_texels] = np.kron(board.cells(tag), block) * 255
            texels_around = int(self.margin * texels)
            rows = slice(max(top - texels_around, 0), top + tag_texels + texels_around)
            labels[rows, max(left - texels_around, 0) : left + tag_texels + texels_around] = tag + 1
        offset = self.margin * texels - 0.5
        return pattern, labels, np.array([[texels, 0, offset], [0, texels, offset], [0, 0, 1]])

    def align(self, gray: np.ndarray, matrix: np.ndarray, camera_from_board: np.ndarray) -> Alignment | None:
        """Fit the pose to an image, starting from one that is right to about two pixels.

        Args:
            gray: [H, W] float32 grey levels of a pinhole image.
            matrix: [3, 3] K.
            camera_from_board: [4, 4] where to start.

        Returns:
            The fit; None if the print does not match the image there, or the fit does not settle.
        """
        pose, variance = camera_from_board.copy(), _START_BLUR**2
        for iteration in range(_ITERATIONS):
            pixels = self._pixels(gray, matrix, pose, variance)
            fit = None if pixels is None else _fit_tags(pixels, len(self.board.tag_corners), iteration >= _COARSE)
            if pixels is None or fit is None:
                return None
            system = _normal_equations(pixels, fit)
            step = np.linalg.solve(system.normal[np.ix_(_FREE, _FREE)], system.gradient[_FREE])
            shift = float(np.sqrt(np.mean((pixels.flow[:, :, :6] @ step[:6]) ** 2)))
            if not np.isfinite(shift):
                return None
            pose = _moved(pose, step[:6] * min(1.0, _LARGEST_STEP / max(shift, 1e-12)))
            widened = variance + np.clip(step[6], -variance / 2, variance + 0.1)
            variance = float(np.clip(widened, _SMALLEST_BLUR**2, _LARGEST_BLUR**2))
            is_last = iteration == _ITERATIONS - 1
            if iteration > _COARSE and shift < (_SETTLED_ENOUGH_PIXELS if is_last else _SETTLED_PIXELS):
                return _alignment(pixels, fit, system, pose, float(np.sqrt(variance)))
        return None

    def _pixels(self, gray: np.ndarray, matrix: np.ndarray, pose: np.ndarray, variance: float) -> "_Pixels | None":
        """The pixels of the image on the board, against the print rendered at a pose; None if it is not in view."""
        region = self._region(gray.shape, matrix, pose)
        if region is None:
            return None
        left, top, width, height = region
        pattern, labels, texel_from_board = self._texture
        homography = matrix @ np.column_stack([pose[:3, 0], pose[:3, 1], pose[:3, 3]])
        to_region = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1]], dtype=np.float64)
        pixel_from_texel = to_region @ homography @ np.linalg.inv(texel_from_board)
        label = cv2.warpPerspective(labels, pixel_from_texel, (width, height), flags=cv2.INTER_NEAREST)
        rows, columns = np.nonzero(label)
        if len(rows) < _FEWEST_PIXELS:
            return None
        rendered = cv2.GaussianBlur(_render(pattern, pixel_from_texel, (width, height)), (0, 0), np.sqrt(variance))
        slope_x = cv2.Sobel(rendered, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)[rows, columns]
        slope_y = cv2.Sobel(rendered, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)[rows, columns]
        bend = cv2.Laplacian(rendered, cv2.CV_32F, ksize=1)[rows, columns]
        place = np.column_stack([columns + left, rows + top]).astype(np.float64)
        flow = _flow(place, matrix, pose)
        # What is at a place moves on, so there the print changes by minus slope times flow; blur is diffusion.
        change = -(slope_x[:, None] * flow[:, 0] + slope_y[:, None] * flow[:, 1])
        return _Pixels(
            tag=label[rows, columns].astype(np.intp) - 1,
            image=gray[top : top + height, left : left + width][rows, columns].astype(np.float64),
            rendered=rendered[rows, columns].astype(np.float64),
            place=place,
            slope=np.column_stack([slope_x, slope_y]).astype(np.float64),
            change=np.column_stack([change, bend / 2]),
            flow=flow,
        )

    def _region(self, shape: tuple[int, ...], matrix: np.ndarray, pose: np.ndarray) -> tuple[int, int, int, int] | None:
        """Left, top, width, height of the part of the image in which the board is; None if it is not in view."""
        (width, height), margin = self.board.size, self.margin
        outline = np.array([(x, y, 0.0) for x in (-margin, width + margin) for y in (-margin, height + margin)])
        seen = outline @ pose[:3, :3].T + pose[:3, 3]
        if not (seen[:, 2] > 0.01).all():
            return None
        places = seen @ matrix.T
        places = places[:, :2] / places[:, 2:]
        low = np.clip(np.floor(places.min(axis=0)) - 3, 0, None).astype(int)
        high = np.minimum(np.ceil(places.max(axis=0)) + 4, [shape[1], shape[0]]).astype(int)
        if (high - low < _SMALLEST_REGION).any():
            return None
        return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


@dataclass(frozen=True, kw_only=True)
class _Pixels:
    """P pixels on the board and how the rendered print changes there."""

    tag: np.ndarray
    """[P] int: index of the tag."""
    image: np.ndarray
    """[P] grey levels seen."""
    rendered: np.ndarray
    """[P] grey levels of the print, 0 to 255, before gain and offset."""
    place: np.ndarray
    """[P, 2] pixels."""
    slope: np.ndarray
    """[P, 2] grey levels a pixel."""
    change: np.ndarray
    """[P, 8] derivative of `rendered` by translation, rotation, logarithm of the focal length and blur variance."""
    flow: np.ndarray
    """[P, 2, 7] pixels by which the first seven move what is at the pixel."""


@dataclass(frozen=True, kw_only=True)
class _TagFit:
    """Gain and offset per tag, and what they leave."""

    gain: np.ndarray
    """[N] of each tag; 0 of those that do not fit."""
    weight: np.ndarray
    """[P] 0..1; 0 on tags that do not fit."""
    residual: np.ndarray
    """[P] grey levels: seen minus expected."""
    noise: float
    """Standard deviation of the residuals, grey levels."""
    count: int
    """N tags."""


@dataclass(frozen=True, kw_only=True)
class _NormalEquations:
    """Gauss-Newton system in the eight parameters, gain and offset of each tag eliminated."""

    normal: np.ndarray
    """[8, 8]."""
    gradient: np.ndarray
    """[8]."""


def _render(pattern: np.ndarray, pixel_from_texel: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """[h, w] float32: the print as pixels that each average over their area."""
    n = _SUPERSAMPLING
    # Pixel centres are at integers, so a pixel's first sample lies (n - 1) / 2n to the left of its centre.
    samples_from_pixel = np.array([[n, 0, (n - 1) / 2], [0, n, (n - 1) / 2], [0, 0, 1]])
    fine = cv2.warpPerspective(
        pattern,
        samples_from_pixel @ pixel_from_texel,
        (size[0] * n, size[1] * n),
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=255,
    )
    return cv2.resize(fine, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _flow(pixels: np.ndarray, matrix: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """[P, 2, 7] derivative of the places [P, 2] of board points by a motion of the board and log focal length."""
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(matrix).T
    depth = (pose[:3, 2] @ pose[:3, 3]) / (rays @ pose[:3, 2])
    x, y = rays[:, 0], rays[:, 1]
    fx, fy = matrix[0, 0], matrix[1, 1]
    zero = np.zeros_like(x)
    along_x = [fx / depth, zero, -fx * x / depth, -fx * x * y, fx * (1 + x * x), -fx * y, fx * x]
    along_y = [zero, fy / depth, -fy * y / depth, -fy * (1 + y * y), fy * x * y, fy * x, fy * y]
    return np.stack([np.stack(along_x, axis=1), np.stack(along_y, axis=1)], axis=1)


def _fit_tags(pixels: _Pixels, count: int, is_robust: bool) -> _TagFit | None:
    """Gain and offset of each tag by reweighted least squares; None if no tag matches."""
    tag, image, rendered = pixels.tag, pixels.image, pixels.rendered
    weight = np.ones(len(tag))
    noise = 0.0
    for round_ in range(3 if is_robust else 1):
        total = np.maximum(np.bincount(tag, weight, count), 1e-9)
        mean_r = np.bincount(tag, weight * rendered, count) / total
        mean_i = np.bincount(tag, weight * image, count) / total
        dr, di = rendered - mean_r[tag], image - mean_i[tag]
        var_r = np.bincount(tag, weight * dr * dr, count) + 1e-9
        var_i = np.bincount(tag, weight * di * di, count) + 1e-9
        cov = np.bincount(tag, weight * dr * di, count)
        gain = cov / var_r
        residual = di - gain[tag] * dr
        if round_ == 0:
            matches = (cov > _MATCHING * np.sqrt(var_r * var_i)) & (total > _FEWEST_PIXELS / 10)
            if not matches.any():
                return None
            on = matches[tag]
        noise = max(float(robust_scale(residual[on])), _LEAST_NOISE)
        if is_robust:
            weight = on * np.clip(1 - (residual / (_TUKEY * noise)) ** 2, 0, None) ** 2
        else:
            weight = on.astype(np.float64)
    return _TagFit(gain=np.where(matches, gain, 0.0), weight=weight, residual=residual, noise=noise, count=count)


def _normal_equations(pixels: _Pixels, fit: _TagFit) -> _NormalEquations:
    change = pixels.change * fit.gain[pixels.tag][:, None]
    weighted = change * fit.weight[:, None]
    normal, gradient = weighted.T @ change, weighted.T @ fit.residual
    for tag in np.flatnonzero(fit.gain):
        on = pixels.tag == tag
        shading = np.column_stack([pixels.rendered[on] / 255, np.ones(np.count_nonzero(on))])
        cross = shading.T @ weighted[on]
        inner = shading.T @ (shading * fit.weight[on][:, None]) + 1e-9 * np.eye(2)
        solved = np.linalg.solve(inner, cross)
        normal -= cross.T @ solved
        gradient -= solved.T @ (shading.T @ (fit.weight[on] * fit.residual[on]))
    return _NormalEquations(normal=normal + 1e-12 * np.diag(np.diag(normal)), gradient=gradient)


def _alignment(pixels: _Pixels, fit: _TagFit, system: _NormalEquations, pose: np.ndarray, blur: float) -> Alignment:
    tags = np.flatnonzero(fit.gain)
    corrections = np.zeros((len(tags), 3))
    for row, tag in enumerate(tags):
        on = pixels.tag == tag
        slope, place = -pixels.slope[on] * fit.gain[tag], pixels.place[on]
        growth = np.sum(slope * (place - place.mean(axis=0)), axis=1)
        change = np.column_stack([slope, growth])
        weighted = change * fit.weight[on][:, None]
        corrections[row] = np.linalg.lstsq(weighted.T @ change, weighted.T @ fit.residual[on], rcond=None)[0]
    pose_and_blur = np.linalg.inv(system.normal[np.ix_(_FREE, _FREE)])
    everything = np.linalg.inv(system.normal)
    return Alignment(
        camera_from_board=pose,
        covariance=fit.noise**2 * pose_and_blur[:6, :6],
        tags=tags,
        tag_offsets=corrections[:, :2],
        tag_growth=float(np.median(corrections[:, 2])),
        blur=blur,
        noise=fit.noise,
        log_focal=(float(everything[6] @ system.gradient), fit.noise * float(np.sqrt(everything[6, 6]))),
    )


def _moved(pose: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """A pose [4, 4] after a small motion [6] in the camera frame: rotation vector applied first, then translation."""
    rotation = cv2.Rodrigues(motion[3:6])[0]
    moved = np.eye(4)
    moved[:3, :3] = rotation @ pose[:3, :3]
    moved[:3, 3] = rotation @ pose[:3, 3] + motion[:3]
    return moved
