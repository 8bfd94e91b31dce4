"""The paper's ablation of canonical coordinates: a radiance field of places in the world, as the original NeRF's.

Shell, opaque core and samples stay as everywhere; only the density's prior in the height is left out, because this
field does not know the height.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn.functional import relu

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
        """As `MlpField`."""
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
