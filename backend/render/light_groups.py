"""The lights of one instant, sampled together: any mixture of them is a mixture of their samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ..geometry.mesh import PosedMesh
from ..light.lamp_samples import LampSamples
from ..light.samples import LightSamples
from ..light.shadow_maps import Bounds
from ..light.sky_samples import SkySamples, division_of
from ..records.light import Light


class LightGroups(NamedTuple):
    """G lights, L lamps in all.

    Attributes:
        skies: of the groups, in the same directions: those that a kept frame would take for their sum.
        lamps: of all groups.
        group_of_lamp: [L].
    """

    skies: tuple[SkySamples, ...]
    lamps: LampSamples
    group_of_lamp: Tensor

    @classmethod
    def of(cls, lights: Sequence[Light], mesh: PosedMesh) -> LightGroups:
        """Sample lights around a hand."""
        bounds, device = Bounds.of(mesh), mesh.vertices.device
        lamps = LampSamples.of(tuple(lamp for light in lights for lamp in light.lamps), bounds)
        group_of_lamp = [group for group, light in enumerate(lights) for _ in light.lamps]
        division = division_of((light.sky for light in lights), "fine")
        skies = tuple(SkySamples.of(light.sky, device, division) for light in lights)
        return cls(skies, lamps, torch.tensor(group_of_lamp, dtype=torch.long, device=device))

    def mixed(self, weights: Float[Tensor, "G 3"]) -> LightSamples:
        """Return the weighted sum of the groups."""
        lamps = self.lamps._replace(rgb=self.lamps.rgb * weights[self.group_of_lamp])
        return LightSamples(SkySamples.mixed(self.skies, weights), lamps)

    def together(self) -> LightSamples:
        """Return their sum."""
        return self.mixed(torch.ones(len(self.skies), 3, device=self.group_of_lamp.device))
