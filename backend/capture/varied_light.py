"""Lights drawn at random around a hand at the world's origin: those of training, and the kinds of the held-out images.

A light's brightness is the pixel value of a white surface that faces it: E / pi. Every light's parts add up to about
`BRIGHTNESS`, so images need no exposure of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ..records.light import Lamp, Light, Sky, rotation_facing
from .dome import dome_sky, fine_directions, sky_of
from .lights import CaptureLight

LightKind = Literal["dome", "soft", "hard", "mixed", "key", "rim", "block"]
BRIGHTNESS = 1.4
TRAINING_SHARES: dict[LightKind, float] = {"dome": 0.08, "soft": 0.28, "hard": 0.18, "mixed": 0.46}
HELD_OUT_KINDS: tuple[LightKind, ...] = ("soft", "key", "rim", "block", "dome")
GROUPS = ("sky", "lamp", "lamps")
"""Light groups of an image: its sky, its first lamp, all other lamps."""

# Of the built-in hand, whose surface lies within 0.147 m of the origin; lengths scale with the size of another hand.
_NEAREST_M, _FARTHEST_M = 0.35, 2.0  # lamps
_SLAB_M, _WALL_M = (0.17, 0.24), (0.17, 0.26)  # distances of occluders
_THICKNESS_M, _CLEARANCE_M = 0.012, 0.01  # of them, and from the skin
# Luminance of Rec.709.
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class LightDrawing:
    """Draws lights around a hand.

    Attributes:
        rng: of every choice.
        towards_camera: [3] unit direction from the hand to the image's camera.
        size: of the hand, relative to the built-in hand's.
        skin_m: [N, 3] points of the hand, through which no slab or wall goes, as an arm would; m, world.
    """

    rng: np.random.Generator
    towards_camera: np.ndarray
    size: float = 1.0
    skin_m: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))

    def training_light(self, has_occluder: bool) -> CaptureLight:
        """Draw a light of one of the kinds of training, with a slab or a wall or without; the dome stands free."""
        kind = self.training_kind()
        drawn = self.light(kind)
        if not has_occluder or kind == "dome":
            return drawn
        if self.rng.random() < 0.5:
            return self._with_occluder(drawn, self._slab(self._main_direction(drawn.light)), self._colour(0.4) * 0.5)
        side = _unit(self.rng.normal(size=3))
        return self._with_occluder(drawn, self._wall(side), self._paint())

    def training_kind(self) -> LightKind:
        """Draw a kind of light by the shares of training."""
        kinds = tuple(TRAINING_SHARES)
        return kinds[self.rng.choice(len(kinds), p=list(TRAINING_SHARES.values()))]

    def light(self, kind: LightKind) -> CaptureLight:
        """Draw a light of this kind."""
        if kind == "dome":
            return CaptureLight(kind, Light(sky=replace(dome_sky(), group=GROUPS[0])))
        if kind == "soft":
            return _levelled(kind, [], [], self._soft_sky(), self._level())
        if kind == "hard":
            lamps = [self._hard_lamp(_unit(self.rng.normal(size=3)))]
        elif kind == "mixed":
            return self._mixed()
        elif kind == "rim":
            lamps = [self._hard_lamp(self._direction_with_cosine(-0.9, -0.3))]
        else:
            lamps = [self._sun(self._direction_with_cosine(0.15, 0.9))]
        dim = self.rng.uniform(0.03, 0.12)
        drawn = _levelled(kind, lamps, [1.0], self._dim_sky(), self._level(), dim)
        return self._blocked(drawn) if kind == "block" else drawn

    def _level(self) -> float:
        return float(BRIGHTNESS * np.exp(self.rng.normal(0, 0.2)))

    def _mixed(self) -> CaptureLight:
        count = int(self.rng.integers(1, 4))
        lamps = [self._any_lamp(_unit(self.rng.normal(size=3))) for _ in range(count)]
        weights = list(np.exp(self.rng.uniform(np.log(0.25), 0, count)))
        sky = self._soft_sky() if self.rng.random() < 0.6 else self._dim_sky()
        return _levelled("mixed", lamps, weights, sky, self._level(), float(np.exp(self.rng.uniform(np.log(0.05), 0))))

    def _blocked(self, drawn: CaptureLight) -> CaptureLight:
        """Hide half of the hand from the sun by a slab, and set a wall in a strong colour, lit by it, beside it."""
        towards = -drawn.light.lamps[0].direction
        blocked = self._with_occluder(drawn, self._slab(towards), np.full(3, 0.3))
        side = np.cross(towards, self.towards_camera)
        if np.linalg.norm(side) < 0.1:
            side = np.cross(towards, [0.3, 0.5, 0.8])
        side = _unit(side) * self.rng.choice([-1, 1]) - self.rng.uniform(0.2, 0.6) * towards
        return self._with_occluder(blocked, self._wall(_unit(side)), self._paint())

    def _direction_with_cosine(self, low: float, high: float) -> np.ndarray:
        """Return a unit direction [3] whose cosine with that to the camera lies between two values."""
        cosine = self.rng.uniform(low, high)
        across = self._perpendicular(self.towards_camera)
        return cosine * self.towards_camera + np.sqrt(1 - cosine**2) * across

    def _perpendicular(self, axis: np.ndarray) -> np.ndarray:
        drawn = self.rng.normal(size=3)
        return _unit(drawn - (drawn @ axis) * axis)

    def _colour(self, spread: float = 0.22) -> np.ndarray:
        """Return a moderate colour [3] of luminance 1: warmer or cooler, and a little off."""
        warm = self.rng.normal(0, spread) * np.array([1.0, 0.1, -1.0])
        colour = np.exp(warm + self.rng.normal(0, spread / 3, 3))
        return colour / (colour @ _LUMINANCE)

    def _paint(self) -> np.ndarray:
        """Return the albedo [3] of a strongly coloured wall, in three of ten cases of a grey one."""
        if self.rng.random() < 0.3:
            return np.full(3, self.rng.uniform(0.1, 0.8))
        paint = self.rng.uniform(0.02, 0.15, 3)
        paint[self.rng.integers(3)] = self.rng.uniform(0.6, 0.85)
        if self.rng.random() < 0.4:
            paint[self.rng.integers(3)] = self.rng.uniform(0.4, 0.8)
        return paint

    def _gradient(self) -> np.ndarray:
        """Compute [H, W, 3] fine radiance of brightness 1 from ground to zenith; mostly upright."""
        up = np.array([0, 0, 1.0]) + self.rng.normal(0, 0.25 if self.rng.random() < 0.8 else 3.0, 3)
        height = (fine_directions() @ _unit(up) + 1)[..., None] / 2
        ground, zenith = self._colour() * self.rng.uniform(0.1, 1.0), self._colour()
        return _to_brightness(ground + (zenith - ground) * height ** self.rng.uniform(0.6, 2.0))

    def _lobe(self) -> np.ndarray:
        """Return [H, W, 3] fine radiance of brightness 1 around a direction."""
        exponent = np.exp(self.rng.uniform(np.log(4), np.log(80)))
        cosine = fine_directions() @ _unit(self.rng.normal(size=3))
        return np.maximum(cosine, 0)[..., None] ** exponent * self._colour() * (exponent + 2) / 2

    def _soft_sky(self) -> Sky:
        radiance = self._gradient() * self.rng.uniform(0.15, 1.0)
        for _ in range(int(self.rng.integers(1, 3))):
            radiance = radiance + self._lobe() * self.rng.uniform(0.3, 1.0)
        return sky_of(radiance)

    def _dim_sky(self) -> Sky:
        return sky_of(self._gradient())

    def _any_lamp(self, towards: np.ndarray) -> Lamp:
        choice = self.rng.integers(3)
        if choice == 0:
            return self._sun(towards)
        if choice == 1:
            return self._point(towards, 0.1)
        side_m = self.size * np.exp(self.rng.uniform(np.log(0.05), np.log(0.6)))
        return self._aimed(Lamp("area", self._colour(), size_m=(float(side_m), float(side_m))), towards)

    def _hard_lamp(self, towards: np.ndarray) -> Lamp:
        choice = self.rng.integers(3)
        if choice == 0:
            return self._sun(towards)
        if choice == 1:
            return self._point(towards, 0.03)
        cone_rad, blend = np.deg2rad(self.rng.uniform(35, 70)), self.rng.uniform(0.1, 0.6)
        radius_m = self.size * self.rng.uniform(0.005, 0.03)
        lamp = Lamp("spot", self._colour(), radius_m=radius_m, cone_rad=float(cone_rad), blend=blend)
        return self._aimed(lamp, towards)

    def _sun(self, towards: np.ndarray) -> Lamp:
        angle_rad = float(np.exp(self.rng.uniform(np.log(0.009), np.log(0.08))))
        return Lamp("sun", self._colour(), rotation=rotation_facing(towards), angle_rad=angle_rad)

    def _point(self, towards: np.ndarray, largest_m: float) -> Lamp:
        radius_m = float(self.size * np.exp(self.rng.uniform(np.log(0.005), np.log(largest_m))))
        return Lamp("point", self._colour(), position=towards * self._distance_m(), radius_m=radius_m)

    def _aimed(self, lamp: Lamp, towards: np.ndarray) -> Lamp:
        """Aim the lamp, at some distance, at a point near the hand's middle."""
        position = towards * self._distance_m()
        from_target = _unit(position + self.size * self.rng.normal(0, 0.02, 3))
        return replace(lamp, position=position, rotation=rotation_facing(from_target))

    def _distance_m(self) -> float:
        return float(self.size * np.exp(self.rng.uniform(np.log(_NEAREST_M), np.log(_FARTHEST_M))))

    def _main_direction(self, light: Light) -> np.ndarray:
        """Return [3] unit direction to one of the lamps, or else to the brightest part of the sky."""
        if light.lamps:
            lamp = light.lamps[int(self.rng.integers(len(light.lamps)))]
            return -lamp.direction if lamp.kind == "sun" else _unit(lamp.position)
        sky = light.sky
        return sky.directions.reshape(-1, 3)[(sky.radiance @ _LUMINANCE).argmax()] if sky else self.towards_camera

    def _slab(self, towards: np.ndarray) -> np.ndarray:
        """Set a slab [12, 3, 3] between the hand and a light; its edge runs near the hand's middle."""
        across = self._perpendicular(towards)
        half = np.array([0.16, 0.22, _THICKNESS_M / 2])
        centre = towards * self.rng.uniform(*_SLAB_M) + across * (half[0] + self.rng.uniform(-0.03, 0.03))
        return self._beyond_skin(centre, np.stack([across, np.cross(towards, across), towards]), half)

    def _wall(self, side: np.ndarray) -> np.ndarray:
        """Return a wall [12, 3, 3] on one side of the hand, facing it."""
        across = self._perpendicular(side)
        half = np.array([*self.rng.uniform(0.2, 0.4, 2), _THICKNESS_M / 2])
        centre = side * (self.rng.uniform(*_WALL_M) + half[2])
        return self._beyond_skin(centre, np.stack([across, np.cross(side, across), side]), half)

    def _beyond_skin(self, centre: np.ndarray, axes: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Build a box [12, 3, 3], moved along its last axis until all of the skin that it covers is before it.

        Args:
            centre: [3] of the built-in hand's.
            axes: [3, 3] unit, in rows.
            half: [3] sides.
        """
        centre, half = centre * self.size, half * self.size
        at = (self.skin_m - centre) @ axes.T
        is_covered = (np.abs(at[:, :2]) < half[:2] + _CLEARANCE_M).all(1)
        reach = at[is_covered, 2].max(initial=-np.inf) + half[2] + _CLEARANCE_M
        return box_triangles(centre + max(reach, 0.0) * axes[2], axes, half)

    def _with_occluder(self, drawn: CaptureLight, triangles: np.ndarray, albedo: np.ndarray) -> CaptureLight:
        light, colour = drawn.light, np.clip(albedo, 0, 0.9)
        occluders = np.concatenate([light.occluders, triangles])
        colours = np.concatenate([light.occluder_albedo, np.repeat(colour[None], len(triangles), 0)])
        return CaptureLight(drawn.kind, replace(light, occluders=occluders, occluder_albedo=colours))


def light_groups(drawn: CaptureLight) -> tuple[CaptureLight, ...]:
    """Split the light into that of each group alone; they add up to the whole."""
    return tuple(replace(drawn, light=drawn.light.of_group(name)) for name in GROUPS if name in drawn.light.groups)


def brightness_of(lamp: Lamp) -> float:
    """Measure the pixel value of a white surface at the origin that faces the lamp; a spot's cone is not asked."""
    luminance = float(lamp.rgb @ _LUMINANCE)
    if lamp.kind == "sun":
        return luminance / np.pi
    distance_m = float(np.linalg.norm(lamp.position))
    return luminance / (np.pi * distance_m) ** 2 / (1 if lamp.kind == "area" else 4)


def sky_brightness(sky: Sky) -> float:
    """Measure the pixel value of a white surface that faces the brightest half of the sky."""
    towards = sky.directions.reshape(-1, 3)
    radiant = ((sky.radiance @ _LUMINANCE) * sky.solid_angles).ravel()
    return float((np.maximum(towards[::8] @ towards.T, 0) @ radiant).max() / np.pi)


def box_triangles(centre: np.ndarray, axes: np.ndarray, half_m: np.ndarray) -> np.ndarray:
    """Build the surface [12, 3, 3] of a box, normals outwards; its unit axes are rows of [3, 3], half sides [3], m."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = centre + (signs * half_m) @ axes
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return np.array([corners[list(three)] for a, b, c, d in quads for three in ((a, b, c), (a, c, d))])


def _levelled(
    kind: LightKind, lamps: list[Lamp], weights: list[float], sky: Sky, level: float, sky_weight: float = 1.0
) -> CaptureLight:
    """Level lamps and sky to these relative brightnesses, which add up to `level`."""
    unit = level / (sum(weights) + sky_weight)
    scaled = [
        replace(lamp, rgb=lamp.rgb * unit * weight / brightness_of(lamp), group=GROUPS[min(index, 1) + 1])
        for index, (lamp, weight) in enumerate(zip(lamps, weights, strict=True))
    ]
    radiance = (sky.radiance * (unit * sky_weight / sky_brightness(sky))).astype(np.float16).astype(np.float32)
    return CaptureLight(kind, Light(tuple(scaled), Sky(radiance, GROUPS[0])))


def _to_brightness(radiance: np.ndarray) -> np.ndarray:
    return radiance / sky_brightness(sky_of(radiance))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
