"""The light of a film or of photographs: lobes of a sky whose sum explains what pictures show of the person.

Light is linear: a picture in the light of every lobe gives the picture in any sum of them. Non-negative least squares
finds the sum; robustly, since some of the hand is not where it is thought to be, and its albedo is not yet known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from ..capture.masks.mask import load_opencv
from ..capture.picture import linear_to_srgb, srgb_to_linear
from ..records.hand_picture import HAND, HandPicture
from ..records.light import Light, Sky, sky_directions
from .model import PersonModel

_SKY_SIZE = 16, 32
_SHARPNESS = 6  # exponent of the cosine of a lobe
_LEAST_RADIANCE = 1e-6
_LEAST_FACING, _BRIGHTEST, _ERODED_PX = 0.4, 0.97, 5
_LONGEST_PX = 300  # of a picture in which light is looked for
_MOST_PIXELS = 6000  # of one picture
_OUTLIER = 0.15  # relative error at which a pixel counts half
_RIDGE = 1e-2
_ROUNDS, _REWEIGHTED = 6, 2


def linear_colours(picture: HandPicture) -> np.ndarray:
    """Return [H, W, 3] float32, scene-linear, in the exposure that all pictures of the scene share."""
    gain = np.exp(np.array(picture.log_gain, np.float32))
    return srgb_to_linear(picture.rgb.astype(np.float32) / 255) / gain


def encoded_colours(picture: HandPicture, linear: np.ndarray) -> np.ndarray:
    """Encode linear colours [..., 3] as this picture's camera would."""
    return linear_to_srgb((linear * np.exp(np.array(picture.log_gain))).clip(0, 1).astype(np.float32))


@dataclass(frozen=True)
class Illumination:
    """The light of the pictures of one scene.

    Attributes:
        lobes: [L] radiance of the sky's lobes, W/(m^2 sr).
        tint: [3] colour of the light over a white one, by the camera's white balance.
    """

    lobes: np.ndarray
    tint: np.ndarray

    @property
    def light(self) -> Light:
        """White light of the lobes, in which a neutral camera would have seen the person."""
        grey = np.tensordot(self.lobes, sky_lobes(), 1)[..., None]
        return Light(sky=Sky(np.repeat(grey, 3, 2) + _LEAST_RADIANCE))


@dataclass(frozen=True)
class LitPixels:
    """Pixels of pictures of one scene, and what they show of a person in the light of each lobe.

    Attributes:
        basis: [P, 3, L] linear.
        shown: [P, 3] linear.
        uv: [P, 2] of the atlas.
    """

    basis: np.ndarray
    shown: np.ndarray
    uv: np.ndarray


def sky_lobes() -> np.ndarray:
    """Compute the lobes [32, H, W] in the directions of an icosahedron's corners and faces."""
    directions = sky_directions(*_SKY_SIZE)
    return np.stack([np.maximum(directions @ axis, 0) ** _SHARPNESS for axis in _axes()])


def lit_pixels(
    model: PersonModel, pictures: Sequence[HandPicture], on_picture: Callable[[], None] = lambda: None
) -> LitPixels:
    """Render pictures of a scene, made small, in the light of every lobe."""
    basis, shown, uv = [], [], []
    for picture in pictures:
        camera = picture.camera.scaled(min(0.5, _LONGEST_PX / max(picture.camera.size_px)))
        linear, is_sure = _made_small(picture, camera.size_px)
        seen = model.seen(picture.pose, camera)
        is_sure &= seen.is_seen & (seen.facing > _LEAST_FACING) & _eroded(seen.is_seen)
        row, column = _spread_out(is_sure)
        frames = [
            model.rendered(picture.pose, camera, Light(sky=Sky(np.repeat(lobe[..., None], 3, 2))))
            for lobe in sky_lobes()
        ]
        alpha = np.maximum(frames[0].alpha[row, column], 1e-3)[:, None, None]
        basis.append(np.stack([frame.rgb[row, column] for frame in frames], -1) / alpha)
        shown.append(linear[row, column])
        uv.append(seen.uv[row, column])
        on_picture()
    return LitPixels(np.concatenate(basis), np.concatenate(shown), np.concatenate(uv))


def fitted_light(pixels: LitPixels, ratio: np.ndarray | None = None) -> Illumination:
    """Fit the light to pixels. Its colour is not told apart from the skin's here, and left to the person's numbers.

    Args:
        pixels: of one scene.
        ratio: [P, 3] of the person's albedo over that of the basis; None: 1.
    """
    basis = pixels.basis if ratio is None else pixels.basis * ratio[..., None]
    tint, lobes = np.ones(3), np.zeros(basis.shape[2])
    mean_basis = basis.mean(1)
    ridge = _RIDGE * np.sqrt(len(basis)) * mean_basis.mean() * np.eye(basis.shape[2])
    for _ in range(_ROUNDS):
        grey = (pixels.shown / tint).mean(1)
        weight = 1 / (grey + 0.05)
        for _ in range(_REWEIGHTED):
            stacked = np.concatenate([mean_basis * weight[:, None], ridge * weight.mean()])
            lobes, _ = nnls(stacked, np.concatenate([grey * weight, np.zeros(len(ridge))]))
            error = np.abs(mean_basis @ lobes - grey) / (grey + 0.05)
            weight = 1 / (grey + 0.05) / np.sqrt(1 + (error / _OUTLIER) ** 2)
        tint = np.exp(np.median(np.log((pixels.shown + 1e-3) / (basis @ lobes + 1e-3)), 0))
    strength = np.exp(np.log(tint).mean())
    return Illumination(lobes * strength, np.ones(3))


def _axes() -> np.ndarray:
    """Return 32 unit directions."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)])
    corners = np.concatenate([corners, np.roll(corners, 1, 1), np.roll(corners, 2, 1)])
    axes = np.concatenate([corners, [corners[face].mean(0) for face in ConvexHull(corners).simplices]])
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _made_small(picture: HandPicture, size_px: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture of this size, linear, and where it surely shows the hand, not clipped."""
    cv2 = load_opencv()
    encoded = cv2.resize(picture.rgb, size_px, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    linear = cv2.resize(linear_colours(picture), size_px, interpolation=cv2.INTER_AREA)
    is_hand = cv2.resize((picture.labels == HAND).astype(np.float32), size_px, interpolation=cv2.INTER_AREA) > 0.9
    return linear, _eroded(is_hand) & (encoded.max(-1) < _BRIGHTEST)


def _eroded(mask: np.ndarray) -> np.ndarray:
    cv2 = load_opencv()
    return cv2.erode(mask.astype(np.uint8), np.ones((_ERODED_PX, _ERODED_PX))) > 0


def _spread_out(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of at most so many of a mask's pixels, evenly."""
    row, column = mask.nonzero()
    step = max(1, len(row) // _MOST_PIXELS)
    return row[::step], column[::step]
