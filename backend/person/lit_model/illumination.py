"""The light of a film or of photographs: lobes of a sky whose sum explains what pictures show of the person.

Light is linear: a picture in the light of every lobe gives the picture in any sum of them. Non-negative least squares
finds the sum; robustly, since some of the hand is not where it is thought to be, and its albedo is not yet known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from ...capture.masks.mask import load_opencv
from ...capture.picture import linear_to_srgb, srgb_to_linear
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.hand_picture import HAND, HandPicture
from ...records.light import Lamp, Light, Sky, sky_directions
from ...system.parallel_map import parallel_map
from .model import PersonModel

_SKY_SIZE = 16, 32
_SHARPNESS = 6  # exponent of the cosine of a lobe
_LEAST_RADIANCE = 1e-6
_LEAST_FACING, _BRIGHTEST, _ERODED_PX = 0.4, 0.97, 5
_LONGEST_PX = 300  # of a picture in which light is looked for
PICTURES_OF_SCENE, _LEAST_PIXELS = 8, 200
_MOST_PIXELS = 6000  # of one picture
_OUTLIER = 0.15  # relative error at which a pixel counts half
_DARK, _LEAST_SHOWN = 0.05, 1e-3  # linear
_RIDGE = 1e-2
_NEAR_RIDGE = 0.17  # of the light of one picture towards that of its scene
_ROUNDS = 6
_MOST_FITTED = 12_000  # pixels of a scene
# A tint so strong costs as much as a melanin that is off by a tenth does in relative errors.
_TINT_DEVIATION, _TINT_COST = 0.06, 4e-4


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
        lamps: white ones beside the sky.
    """

    lobes: np.ndarray
    tint: np.ndarray
    lamps: tuple[Lamp, ...] = ()

    @classmethod
    def of(cls, fit: LitStrengths, sources: Sequence[Light]) -> Illumination:
        """Take a fit's light of these sources, the lobes first."""
        lamps = tuple(
            replace(lamp, rgb=strength * np.asarray(lamp.rgb))
            for source, strength in zip(sources, fit.strengths, strict=True)
            for lamp in source.lamps
            if strength > 0
        )
        return cls(fit.strengths[: len(lobe_directions())], np.exp(fit.log_tint), lamps)

    def stronger(self, log_gain: float, tint: np.ndarray) -> Illumination:
        """Return this light, so much stronger, with another tint."""
        gain = np.exp(log_gain)
        lamps = tuple(replace(lamp, rgb=gain * np.asarray(lamp.rgb)) for lamp in self.lamps)
        return Illumination(gain * self.lobes, tint, lamps)

    @property
    def light(self) -> Light:
        """White light of all, in which a neutral camera would have seen the person."""
        grey = np.tensordot(self.lobes, sky_lobes(), 1)[..., None]
        return Light(self.lamps, Sky(np.repeat(grey, 3, 2) + _LEAST_RADIANCE))

    @property
    def tinted(self) -> Light:
        """The light in its colour, as the pictures' white balance shows it."""
        sky = self.light.sky
        assert sky is not None
        lamps = tuple(replace(lamp, rgb=self.tint * np.asarray(lamp.rgb)) for lamp in self.lamps)
        return Light(lamps, Sky(sky.radiance * self.tint))


@dataclass(frozen=True)
class SurePixels:
    """The pixels of one picture, made small, that surely show skin.

    Attributes:
        picture: whose they are.
        camera: of the small picture.
        row, column: [P] in it.
        shown: [P, 3] linear.
        uv: [P, 2] of the atlas.
    """

    picture: HandPicture
    camera: Camera
    row: np.ndarray
    column: np.ndarray
    shown: np.ndarray
    uv: np.ndarray

    @classmethod
    def of(cls, model: PersonModel, picture: HandPicture) -> SurePixels:
        """Find them."""
        camera = picture.camera.scaled(min(0.5, _LONGEST_PX / max(picture.camera.size_px)))
        linear, is_sure = _made_small(picture, camera.size_px)
        seen = model.seen(picture.pose, camera)
        row, column = _spread_out(is_sure & seen.is_seen & (seen.facing > _LEAST_FACING) & _eroded(seen.is_seen))
        return cls(picture, camera, row, column, linear[row, column], seen.uv[row, column])

    def lit(self, model: PersonModel, sources: Sequence[Light]) -> tuple[np.ndarray, np.ndarray]:
        """Render what they show in each of S lights: [P, 3, S] of the skin's body, and of its surface."""
        frames = model.rendered_parts(self.picture.pose, self.camera, sources)
        alpha = np.maximum(frames[0].diffuse.alpha[self.row, self.column], 1e-3)[:, None, None]
        diffuse, specular = (
            np.stack([part.rgb[self.row, self.column] for part in parts], -1) / alpha
            for parts in zip(*frames, strict=True)
        )
        return diffuse, specular


@dataclass(frozen=True)
class LitPixels:
    """Pixels of pictures of one scene, and what they would show of a person in each of S lights of it.

    Attributes:
        sources: S lights: the sky's lobes, and lamps after them.
        diffuse: [P, 3, S] linear, in proportion to the albedo.
        specular: [P, 3, S] linear, whatever the albedo.
        shown: [P, 3] linear.
        uv: [P, 2] of the atlas.
        parts: the pictures' pixels, in order.
    """

    sources: tuple[Light, ...]
    diffuse: np.ndarray
    specular: np.ndarray
    shown: np.ndarray
    uv: np.ndarray
    parts: tuple[SurePixels, ...] = ()

    def basis(self, ratio: np.ndarray) -> np.ndarray:
        """Compute [P, 3, S] for the albedo of `diffuse` times a ratio [P, 3]."""
        return self.specular + self.diffuse * ratio[..., None]

    def with_sources(self, model: PersonModel, sources: Sequence[Light]) -> LitPixels:
        """Return these pixels in more lights."""
        if not sources:
            return self
        diffuse, specular = _lit(model, self.parts, sources)
        return replace(
            self,
            sources=(*self.sources, *sources),
            diffuse=np.concatenate([self.diffuse, diffuse], 2),
            specular=np.concatenate([self.specular, specular], 2),
        )

    def by_picture(self) -> list[LitPixels]:
        """Return the pixels of each picture."""
        ends = np.cumsum([len(part.row) for part in self.parts])[:-1]
        fields = [np.split(each, ends) for each in (self.diffuse, self.specular)]
        return [
            replace(self, diffuse=diffuse, specular=specular, shown=part.shown, uv=part.uv, parts=(part,))
            for diffuse, specular, part in zip(*fields, self.parts, strict=True)
        ]

    def of_sources(self, chosen: Sequence[int]) -> LitPixels:
        """Return these pixels in some of their lights."""
        sources = tuple(self.sources[index] for index in chosen)
        kept = np.array(chosen, int)
        return replace(self, sources=sources, diffuse=self.diffuse[..., kept], specular=self.specular[..., kept])


class LitStrengths(NamedTuple):
    """A light that explains pixels.

    Attributes:
        strengths: [S] of the pixels' sources.
        log_tint: [3] of its colour and the camera's white balance; its mean is 0.
        error: robust mean of squared relative errors, and what the tint costs.
    """

    strengths: np.ndarray
    log_tint: np.ndarray
    error: float


def sky_lobes() -> np.ndarray:
    """Compute the lobes [32, H, W] in the directions of an icosahedron's corners and faces."""
    directions = sky_directions(*_SKY_SIZE)
    return np.stack([np.maximum(directions @ axis, 0) ** _SHARPNESS for axis in lobe_directions()])


def lit_pixels(
    model: PersonModel, pictures: Sequence[HandPicture], on_picture: Callable[[], None] = lambda: None
) -> LitPixels:
    """Render pictures of a scene, made small, in the light of every lobe."""
    parts = tuple(parallel_map(partial(SurePixels.of, model), pictures))
    sources = tuple(Light(sky=Sky(np.repeat(lobe[..., None], 3, 2))) for lobe in sky_lobes())
    diffuse, specular = _lit(model, parts, sources, on_picture)
    shown, uv = (np.concatenate([getattr(part, name) for part in parts]) for name in ("shown", "uv"))
    return LitPixels(sources, diffuse, specular, shown, uv, parts)


def pixels_of_scenes(
    model: PersonModel, pictures: Sequence[HandPicture], most: int = PICTURES_OF_SCENE
) -> dict[int, LitPixels]:
    """Render some pictures of every scene in the light of every lobe: of those that are not held out, if there are any.

    Raises:
        LiveHandError: pictures of a scene show hardly any skin.
    """
    pixels = {}
    for scene in sorted({picture.scene for picture in pictures}):
        of_scene = [picture for picture in pictures if picture.scene == scene]
        chosen = evenly_chosen([one for one in of_scene if not one.is_held_out] or of_scene, most)
        pixels[scene] = lit_pixels(model, chosen)
        if len(pixels[scene].shown) < _LEAST_PIXELS:
            names = ", ".join(picture.name for picture in chosen)
            raise LiveHandError(
                f"{names} must show the hand free and not clipped, got {len(pixels[scene].shown)} pixels of sure skin; "
                "leave these pictures out, or film in softer light"
            )
    return pixels


def lamps_of(pixels: Mapping[int, LitPixels]) -> dict[int, tuple[Light, ...]]:
    """Return the lamps of every scene's sources."""
    return {scene: tuple(one for one in of_scene.sources if one.lamps) for scene, of_scene in pixels.items()}


def evenly_chosen(pictures: Sequence[HandPicture], most: int) -> list[HandPicture]:
    """Choose at most so many pictures, from the first to the last."""
    indices = np.linspace(0, len(pictures) - 1, min(most, len(pictures))).round().astype(int)
    return [pictures[index] for index in indices]


def _lit(
    model: PersonModel,
    parts: Sequence[SurePixels],
    sources: Sequence[Light],
    on_picture: Callable[[], None] = lambda: None,
) -> tuple[np.ndarray, np.ndarray]:
    found = parallel_map(lambda part: part.lit(model, sources), parts, on_picture)
    diffuse, specular = (np.concatenate(values) for values in zip(*found, strict=True))
    return diffuse, specular


def fitted_light(pixels: LitPixels, ratio: np.ndarray, near: LitStrengths | None = None) -> LitStrengths:
    """Fit a light of one colour to pixels.

    Args:
        pixels: of one scene.
        ratio: [P, 3] of the person's albedo over that of the pixels' `diffuse`.
        near: a light of the same sources, which this one is like: as strong, with its tint; None: none is known.
    """
    step = max(1, len(pixels.shown) // _MOST_FITTED)
    basis, shown = pixels.basis(ratio)[::step].astype(np.float64), pixels.shown[::step].astype(np.float64)
    log_tint, expected, ridge_of_mean = np.zeros(3), np.zeros(basis.shape[2]), _RIDGE
    if near is not None:
        log_tint, expected, ridge_of_mean = near.log_tint, near.strengths, _NEAR_RIDGE
        shown = shown / np.exp(np.median(_log_gains(shown, basis @ expected * np.exp(log_tint))))
    scale = 1 / (shown + _DARK)
    weight, strengths = np.ones_like(scale), expected
    ridge = np.diag((ridge_of_mean * scale.mean() * basis.mean((0, 1))) ** 2 * len(basis))
    error = np.zeros_like(scale)
    for _ in range(_ROUNDS):
        tinted = basis * np.exp(log_tint)[:, None]
        columns = (tinted * (scale * weight)[..., None]).reshape(-1, basis.shape[2])
        root = np.linalg.cholesky(columns.T @ columns + ridge)
        wanted = columns.T @ (shown * scale * weight).ravel() + ridge @ expected
        strengths, _ = nnls(root.T, np.linalg.solve(root, wanted))
        error = (tinted @ strengths - shown) * scale
        weight = 1 / np.sqrt(1 + (error / _OUTLIER) ** 2)
        if near is None:
            log_tint = np.median(_log_gains(shown, basis @ strengths), 0)
            log_tint -= log_tint.mean()
    return LitStrengths(
        strengths, log_tint, _robust(error) + _TINT_COST * float(log_tint @ log_tint) / _TINT_DEVIATION**2
    )


def error_of(light: LitStrengths, pixels: LitPixels, ratio: np.ndarray) -> float:
    """Measure the robust mean of squared relative errors that a light leaves in pixels, after their median gain."""
    rendered = pixels.basis(ratio).astype(np.float64) @ light.strengths * np.exp(light.log_tint)
    shown = pixels.shown / np.exp(np.median(_log_gains(pixels.shown, rendered)))
    return _robust((rendered - shown) / (shown + _DARK))


def _robust(error: np.ndarray) -> float:
    return float((_OUTLIER**2 * np.log1p((error / _OUTLIER) ** 2)).mean())


def _log_gains(shown: np.ndarray, rendered: np.ndarray) -> np.ndarray:
    return np.log((shown + _LEAST_SHOWN) / (rendered + _LEAST_SHOWN))


def lobe_directions() -> np.ndarray:
    """Return [32, 3] unit directions of the lobes, world."""
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
