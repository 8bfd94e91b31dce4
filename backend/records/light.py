"""The light that falls on a hand: lamps, the sky, and what stands in their way.

Colours are scene-linear Rec.709. Quantities are physical and those of Blender: a white diffuse surface under the
irradiance E, W/m^2, has the pixel value E / pi.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import pi
from typing import Literal

import numpy as np

from .errors import LiveHandError

LampKind = Literal["sun", "point", "spot", "area"]
ShadowQuality = Literal["none", "coarse", "fine"]
_LAMP_KINDS = ("sun", "point", "spot", "area")
_ROTATION_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Lamp:
    """One lamp. Its axes are Blender's: it emits along its own -Z.

    Attributes:
        kind: which of the attributes below it uses.
        rgb: [3] sun: irradiance of a surface that faces it, W/m^2; all others: emitted power, W. A spot's power is that
            of a point lamp of the same intensity.
        position: [3] world, m; unused for a sun.
        rotation: [3, 3] lamp axes -> world.
        radius_m: of a point's or a spot's sphere.
        angle_rad: angular diameter of a sun.
        size_m: (along X, along Y) of an area lamp.
        is_ellipse: whether an area lamp is an ellipse with these diameters, or a rectangle.
        spread_rad: full angle of an area lamp's beam; pi: no limit.
        cone_rad: full angle of a spot's cone.
        blend: share of a spot's cone over which its edge softens, 0 to 1.
        group: the light group that it belongs to; empty: none.
        casts_shadow: whether hand and occluders block it.
    """

    kind: LampKind
    rgb: np.ndarray
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    radius_m: float = 0.0
    angle_rad: float = 0.0
    size_m: tuple[float, float] = (0.0, 0.0)
    is_ellipse: bool = False
    spread_rad: float = pi
    cone_rad: float = pi / 4
    blend: float = 0.15
    group: str = ""
    casts_shadow: bool = True

    def __post_init__(self):
        if self.kind not in _LAMP_KINDS:
            raise LiveHandError(f"a lamp's kind must be one of {_LAMP_KINDS}, got {self.kind!r}")
        for name, shape in (("rgb", (3,)), ("position", (3,)), ("rotation", (3, 3))):
            _check_array(f"a lamp's {name}", getattr(self, name), shape)
        if np.min(self.rgb) < 0:
            raise LiveHandError(f"a lamp's rgb must not be negative, got {np.asarray(self.rgb).tolist()}")
        if np.abs(self.rotation.T @ self.rotation - np.eye(3)).max() > _ROTATION_TOLERANCE:
            raise LiveHandError("a lamp's rotation must be a rotation, got a scaled or sheared matrix")
        sizes = (self.radius_m, self.angle_rad, *self.size_m, self.spread_rad, self.cone_rad, self.blend)
        if not (np.isfinite(sizes).all() and min(sizes) >= 0):
            raise LiveHandError(f"a lamp's sizes and angles must be finite and not negative, got {sizes}")

    @property
    def direction(self) -> np.ndarray:
        """[3] unit direction in which it emits, world."""
        return -self.rotation[:, 2]


def rotation_facing(towards: np.ndarray) -> np.ndarray:
    """Compute [3, 3] rotation of a lamp that stands in the unit direction `towards` [3] and shines back."""
    across = np.cross([0, 0, 1.0] if abs(towards[2]) < 0.9 else [0, 1.0, 0], towards)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(towards, across), towards], 1)


@dataclass(frozen=True)
class Sky:
    """The radiance that arrives from every direction, W/(m^2 sr).

    Attributes:
        radiance: [H, W, 3] equirectangular as Blender's environment textures: the top row is up (+Z), the centre is +X,
            and columns run clockwise seen from above.
        group: the light group that it belongs to; empty: none.
    """

    radiance: np.ndarray
    group: str = ""

    def __post_init__(self):
        shape = np.shape(self.radiance)
        if len(shape) != 3 or shape[2] != 3 or min(shape[:2]) < 1:
            raise LiveHandError(f"a sky must be [H, W, 3], got {list(shape)}")
        if not np.isfinite(self.radiance).all() or np.min(self.radiance) < 0:
            raise LiveHandError("a sky must be finite and not negative, got NaN, infinity or negative radiance")

    @property
    def directions(self) -> np.ndarray:
        """[H, W, 3] unit directions of the texels' centres, world."""
        return sky_directions(*self.radiance.shape[:2])

    @property
    def solid_angles(self) -> np.ndarray:
        """[H, W] of the texels, sr; they add up to 4 pi."""
        height, width = self.radiance.shape[:2]
        edges = np.cos(np.arange(height + 1) * pi / height)
        return np.repeat((edges[:-1] - edges[1:])[:, None] * (2 * pi / width), width, 1)


def sky_directions(height: int, width: int) -> np.ndarray:
    """Compute [H, W, 3] unit directions of the centres of an equirectangular map's texels, world; as in `Sky`."""
    elevation = pi / 2 - (np.arange(height) + 0.5) * pi / height
    azimuth = pi - (np.arange(width) + 0.5) * 2 * pi / width
    across = np.cos(elevation)[:, None]
    up = np.broadcast_to(np.sin(elevation)[:, None], (height, width))
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), up], -1)


@dataclass(frozen=True)
class MeasuredLight:
    """What a path tracer measures on the bare hand: a white diffuse surface in the scene, divided by pi as a pixel is.

    The maps show the whole image of the shot's camera, at any resolution; they are zero beside the hand.

    Attributes:
        direct: [h, w, 3] light that comes straight from lamps, sky and emitting objects.
        indirect: [h, w, 3] light that the scene and the hand itself have reflected.
        alpha: [h, w] share of each pixel that shows the hand.
        on_surface: whether that showed the skin's own surface (`SurfaceMesh`), not its mesh.
    """

    direct: np.ndarray
    indirect: np.ndarray
    alpha: np.ndarray
    on_surface: bool = False

    def __post_init__(self):
        shape = np.shape(self.alpha)
        if len(shape) != 2 or min(shape) < 1:
            raise LiveHandError(f"a measured alpha must be [h, w], got {list(shape)}")
        for name in ("direct", "indirect"):
            _check_array(f"the measured {name} light", getattr(self, name), (*shape, 3))


@dataclass(frozen=True)
class Light:
    """All light of a frame.

    Attributes:
        lamps: in any order.
        sky: of the world; None: black.
        occluders: [T, 3, 3] corners of the scene's triangles that may shadow the hand, world, m.
        occluder_albedo: [T, 3] of these, as if they were diffuse, for indirect light on the hand; [0, 3]: all black.
        measured: what a path tracer found on the bare hand of the same frame, which corrects all of the above; None: it
            was not asked.
        shadow_quality: how many steps the edges of soft shadows have. A frame that is kept shows steps that nobody sees
            in a preview, and steps cost time.
    """

    lamps: tuple[Lamp, ...] = ()
    sky: Sky | None = None
    occluders: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    occluder_albedo: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    measured: MeasuredLight | None = None
    shadow_quality: ShadowQuality = "coarse"

    def __post_init__(self):
        if np.ndim(self.occluders) != 3 or np.shape(self.occluders)[1:] != (3, 3):
            raise LiveHandError(f"occluders must be triangles [T, 3, 3], got {list(np.shape(self.occluders))}")
        if not np.isfinite(self.occluders).all():
            raise LiveHandError("occluders must be finite, got NaN or infinity in their corners")
        expected, got = [len(self.occluders), 3], list(np.shape(self.occluder_albedo))
        if got not in (expected, [0, 3]):
            raise LiveHandError(f"occluder_albedo must be {expected}, one of every occluder, got {got}")
        if not ((0 <= self.occluder_albedo) & (self.occluder_albedo <= 1)).all():
            raise LiveHandError("occluder_albedo must be between 0 and 1")

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the light groups in order of appearance; light of no group is the empty name."""
        names = [lamp.group for lamp in self.lamps] + ([self.sky.group] if self.sky is not None else [])
        return tuple(dict.fromkeys(names))

    @property
    def is_dark(self) -> bool:
        """Whether nothing emits; what was measured does not count."""
        sky = 0.0 if self.sky is None else np.max(self.sky.radiance)
        return not (sky > 0 or any(np.max(lamp.rgb) > 0 for lamp in self.lamps))

    def of_group(self, name: str) -> Light:
        """Select the light of one group alone; the occluders stay, and nothing is measured of a group."""
        sky = self.sky if self.sky is not None and self.sky.group == name else None
        lamps = tuple(lamp for lamp in self.lamps if lamp.group == name)
        return replace(self, lamps=lamps, sky=sky, measured=None)


def _check_array(name: str, value: np.ndarray, shape: tuple[int, ...]) -> None:
    if np.shape(value) != shape:
        raise LiveHandError(f"{name} must be {list(shape)}, got {list(np.shape(value))}")
    if not np.isfinite(value).all():
        raise LiveHandError(f"{name} must be finite, got NaN or infinity")
