"""The sizes of lit frames."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

from ...light.shadow_maps import CELL_MAP_PX, LAMP_MAP_PX, SKY_MAP_PX, SOFT_MAP_PX, SURFEL_MAP_PX
from ...light.sky_samples import SKY_DIRECTIONS
from ..whole_frames import LitShot

EDGE_SHARE = 0.125
"""Of the pixels of an image, how many may show two parts of a hand; most that was seen: 0.05."""


@dataclass(frozen=True)
class ImageShape:
    """The size of a frame's rays: frames of one shape share buffers, and a recorded sequence.

    Attributes:
        size_px: of the rays' image.
    """

    size_px: tuple[int, int]

    @property
    def rays(self) -> int:
        """Most rays: one for each pixel of their image."""
        return self.size_px[0] * self.size_px[1]


@dataclass(frozen=True)
class FrameShape(ImageShape):
    """The sizes of a lit frame.

    Attributes:
        sky: directions.
        samples: of all lamps.
        hard: of these, of lamps whose shadows have edges.
        lamps: their number.
        at_surfels: samples of all lamps at surfels.
        has_fine_shadows: whether all of the surface's faces cast those of hard lamps.
        triangles: of nearby geometry, at most.
        has_patches: whether it reflects light.
        has_hairs: whether any are shown.
        is_pressed: whether skin is, anywhere.
    """

    sky: int
    samples: int
    hard: int
    lamps: int
    at_surfels: int = 0
    has_fine_shadows: bool = False
    triangles: int = 0
    has_patches: bool = False
    has_hairs: bool = False
    is_pressed: bool = False

    @classmethod
    def of(cls, shot: LitShot) -> FrameShape:
        """Measure a shot."""
        sky, lamps = shot.light
        return cls(
            size_px=shot.camera.size_px,
            sky=len(sky.towards),
            samples=len(lamps.lamp),
            hard=int(shot.is_hard.sum()),
            lamps=len(lamps.rgb),
            at_surfels=len(shot.at_surfels.lamp),
            has_fine_shadows=shot.has_fine_shadows,
            triangles=_room_for(len(shot.occluders)),
            has_patches=shot.patches is not None,
            has_hairs=shot.hairs > 0,
            is_pressed=shot.pressed is not None,
        )

    @property
    def edges(self) -> int:
        """Most pixels of the full-size image that show two parts."""
        return int(4 * self.rays * EDGE_SHARE)

    @property
    def views(self) -> int:
        """Of the hand from its light, or of nearby patches and the hand from theirs."""
        return sum(self.view_counts)

    @property
    def view_counts(self) -> tuple[int, ...]:
        """Of the views: from the sky, from lamps at rays, from lamps at surfels, and from sky and lamps at patches."""
        at_patches = (self.sky, self.at_surfels) if self.has_patches else (0, 0)
        return self.sky, self.samples, self.at_surfels, *at_patches

    @property
    def view_groups(self) -> tuple[slice, ...]:
        """Where each of these lie among all."""
        ends = list(accumulate(self.view_counts))
        return tuple(slice(end - count, end) for end, count in zip(ends, self.view_counts, strict=True))

    @property
    def map_cells(self) -> int:
        """Of all shadow maps, in three layers each."""
        soft, (_, _, at_surfels, sky_at_patches, lamps_at_patches) = self.samples - self.hard, self.view_counts
        parts = self.sky - SKY_DIRECTIONS
        of_sky = SKY_DIRECTIONS * CELL_MAP_PX**2 + (parts + sky_at_patches) * SKY_MAP_PX**2
        cells = of_sky + at_surfels * SURFEL_MAP_PX**2
        return 3 * (cells + (self.hard + lamps_at_patches) * LAMP_MAP_PX**2 + soft * SOFT_MAP_PX**2)

    @property
    def casts_finest(self) -> bool:
        """Whether any lamp's shadows are those of all the surface's faces."""
        return self.has_fine_shadows and self.hard > 0


def _room_for(count: int) -> int:
    """Round a number of triangles up, so that few shapes have them all."""
    return 0 if count == 0 else max(64, 1 << (count - 1).bit_length())
