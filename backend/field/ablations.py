"""The paper's ablations of canonical coordinates: a space for each bone, and the world's.

w_k are the skinning weights of the nearest surface point; most are 0, and those bones' networks are not asked. Density
has no prior in the height, which these networks do not know; shell, opaque core and samples stay.

Shell, opaque core and samples stay as everywhere; only the density's prior in the height is left out, because this
field does not know the height.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import relu

from ..records.errors import LiveHandError
from .conditions import FieldInputs
from .encoding import FeaturePlane, PlaneReader, positional_encoding
from .field import (
    CHANNELS,
    POSITION_INPUTS,
    POSITION_OCTAVES,
    VIEW_INPUTS,
    VIEW_OCTAVES,
    MlpField,
    density_without_height,
    straight_channels,
)
from .volume import Composite, Steps, composite

BONES = 16
_UNIT_M = 0.03  # of points in a bone's frame


class BoneNetwork(nn.Module):
    """One bone's network: 96 wide instead of the paper's 128 and without the pose, 51,009 parameters."""

    WIDTH = 96

    def __init__(self, has_pose: bool):
        super().__init__()
        width = self.WIDTH
        self.position = nn.Linear(POSITION_INPUTS, width)
        self.pose = nn.Linear(48, width, bias=False) if has_pose else None
        self.trunk = nn.ModuleList(nn.Linear(width, width) for _ in range(3))
        self.density = nn.Linear(width, 1)
        self.bottleneck = nn.Linear(width, width)
        self.view = nn.Linear(width + VIEW_INPUTS, width // 2)
        self.channels = nn.Linear(width // 2, CHANNELS)

    def forward(self, place: Float[Tensor, "S 3"], view: Float[Tensor, "S D"], theta: Tensor) -> Float[Tensor, "S 33"]:
        """Return density per mm, and channels."""
        first = self.position(positional_encoding(place / _UNIT_M, POSITION_OCTAVES))
        hidden = relu(first + self.pose(theta) if self.pose is not None else first)
        for layer in self.trunk:
            hidden = relu(layer(hidden))
        sigma = density_without_height(self.density(hidden)[:, 0])
        seen = relu(self.view(torch.cat([self.bottleneck(hidden), view], -1)))
        return torch.cat([sigma[:, None], straight_channels(self.channels(seen)).float()], 1)


class BonesField(MlpField):
    """Sixteen networks, blended.

    Attributes:
        is_dense: whether bones without weight are asked too, as the paper does; the result is the same.
    """

    asks = "bones"

    def __init__(self, has_pose: bool = False):
        super().__init__()
        self.bones = nn.ModuleList(BoneNetwork(has_pose) for _ in range(BONES))
        self.is_dense = False

    def forward(self, inputs: FieldInputs, steps: Steps, read_plane: PlaneReader = FeaturePlane.forward) -> Composite:
        """Return volume-rendered channels, as `MlpField`."""
        place = inputs.place
        assert place is not None, "shading gives a field what it asks for"
        if place.in_bones.shape[1] != BONES:
            raise LiveHandError(
                "a field of bones needs the bones' frames, and corrected poses have none; train it without --refine"
            )
        view = positional_encoding(inputs.view, VIEW_OCTAVES).repeat_interleave(steps.t.shape[1], 0)
        summed = place.world.new_zeros(len(place.world), 1 + CHANNELS)
        for bone, network in enumerate(self.bones):
            weight = place.bone_weights[:, bone]
            asked = torch.arange(len(weight), device=weight.device) if self.is_dense else weight.nonzero()[:, 0]
            if not len(asked):
                continue
            found = network(place.in_bones[asked, bone], view[asked], inputs.theta)
            summed = summed.index_add(0, asked, weight[asked, None] * found.to(summed.dtype))
        return composite(summed[:, 0], summed[:, 1:], steps)


_SKIP = 4  # of the layers after the first: it gets the inputs again


class XyzField(MlpField):
    """8 x 256 on raw metres of the world and the pose, of the published 624,161 parameters.

    Products with the pose are the same for all samples and are computed once.
    """

    asks = "world"
    WIDTH, VIEW_WIDTH = 256, 128

    def __init__(self, has_pose: bool = True):
        super().__init__()
        width = self.WIDTH
        self.position = nn.ModuleList(nn.Linear(POSITION_INPUTS, width, bias=is_first) for is_first in (True, False))
        self.pose = nn.ModuleList(nn.Linear(48, width, bias=False) for _ in range(2)) if has_pose else None
        self.trunk = nn.ModuleList(nn.Linear(width, width) for _ in range(7))
        self.density = nn.Linear(width, 1)
        self.bottleneck = nn.Linear(width, width)
        self.view = nn.Linear(width + VIEW_INPUTS, self.VIEW_WIDTH)
        self.channels = nn.Linear(self.VIEW_WIDTH, CHANNELS)

    def forward(self, inputs: FieldInputs, steps: Steps, read_plane: PlaneReader = FeaturePlane.forward) -> Composite:
        """Return volume-rendered channels, as `MlpField`."""
        assert inputs.place is not None, "shading gives a field what it asks for"
        encoded = positional_encoding(inputs.place.world, POSITION_OCTAVES)
        given = [layer(encoded) for layer in self.position]
        if self.pose is not None:
            given = [of_place + layer(inputs.theta) for of_place, layer in zip(given, self.pose, strict=True)]
        hidden = relu(given[0])
        for index, layer in enumerate(self.trunk):
            hidden = relu(layer(hidden) + given[1] if index == _SKIP else layer(hidden))
        sigma = density_without_height(self.density(hidden)[:, 0])
        view = positional_encoding(inputs.view, VIEW_OCTAVES).repeat_interleave(steps.t.shape[1], 0)
        seen = relu(self.view(torch.cat([self.bottleneck(hidden), view], -1)))
        return composite(sigma, straight_channels(self.channels(seen)), steps)
