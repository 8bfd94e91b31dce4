"""The radiance field H(u, v, h, view, pose) -> (density, colour, features): the paper's, and one of feature planes.

Both volume-render 32 channels: colour (sRGB-encoded, [0, 1]) and 29 features for super-resolution. Densities are per
millimetre, so that the networks' outputs are of order one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import relu, softplus

from ..geometry.visibility import DIRECTIONS
from .conditions import EXPOSURE_CHANNELS, LOCAL_POSE_CHANNELS, FieldInputs, view_features
from .encoding import FeaturePlane, positional_encoding
from .volume import Composite, Steps, composite

FEATURE_CHANNELS = 29
CHANNELS = 3 + FEATURE_CHANNELS

# Density before anything is learnt: solid inside the surface, clear outside, half-way at the surface.
PRIOR_SLOPE, PRIOR_OFFSET = -6.0, -1.0
# Keeps the mean finite where a ray meets next to nothing.
_MIN_ALPHA = 1e-4
# Slows the relief plane's learning against the others': its useful values are a few tenths.
RELIEF_GAIN = 0.25


@dataclass(frozen=True)
class FieldConfig:
    """Which field, and its size."""

    kind: Literal["paper", "planes"] = "planes"
    """`paper`: positional encoding and a 4 x 128 MLP, 92,577 parameters. `planes`: learned feature planes."""
    width: int = 192
    """Of the planes' decoder, asked once a ray."""
    density_width: int = 32
    """Of the layer that turns features into density, asked at every sample."""
    planes: tuple[tuple[int, int, int], ...] = ((64, 6, 8), (128, 3, 8), (256, 3, 8), (512, 1, 4))
    """(resolution, heights, channels) of each plane."""
    relief: int = 384
    """Resolution of the relief plane, a learnt normal map."""
    atlas_m: float = 0.27
    """Length on the skin that one atlas unit spans, about; it says which planes are finer than a pixel."""
    pose: bool = True
    """Whether the planes are decoded with the local pose; without it (the ablation) only the posed surface tells."""


def build_field(config: FieldConfig) -> PaperField | PlaneField:
    """The field the configuration names, with fresh weights."""
    return PaperField() if config.kind == "paper" else PlaneField(config)


class PaperField(nn.Module):
    """The paper's MLP (supplement; sizes as published), in corrected units: h in units of the shell.

    The pose's part of the first layer is the same for all samples of a frame and is computed once.
    """

    POSITION_OCTAVES, VIEW_OCTAVES, WIDTH = 10, 4, 128

    def __init__(self):
        super().__init__()
        width = self.WIDTH
        self.position = nn.Linear(3 * (1 + 2 * self.POSITION_OCTAVES), width)
        self.pose = nn.Linear(48, width, bias=False)
        self.trunk = nn.ModuleList(nn.Linear(width, width) for _ in range(3))
        self.density = nn.Linear(width, 1)
        self.bottleneck = nn.Linear(width, width)
        self.view = nn.Linear(width + 3 * (1 + 2 * self.VIEW_OCTAVES), 64)
        self.channels = nn.Linear(64, CHANNELS)

    def exposure(self, visibility: Float[Tensor, "V K"]) -> Float[Tensor, "V 0"]:
        """Nothing: the paper's field is told nothing of self-shadowing."""
        return visibility[:, :0]

    def forward(self, inputs: FieldInputs, steps: Steps) -> Composite:
        """Volume-rendered channels [R, 32], premultiplied."""
        uvh = torch.cat([inputs.uv, inputs.height[:, None]], -1)
        hidden = relu(self.position(positional_encoding(uvh, self.POSITION_OCTAVES)) + self.pose(inputs.theta))
        for layer in self.trunk:
            hidden = relu(layer(hidden))
        sigma = _density(self.density(hidden)[:, 0], inputs.height)
        view = positional_encoding(inputs.view, self.VIEW_OCTAVES).repeat_interleave(steps.t.shape[1], 0)
        seen = torch.cat([self.bottleneck(hidden), view], -1)
        return composite(sigma, _channels(self.channels(relu(self.view(seen)))), steps)


class PlaneField(nn.Module):
    """Feature planes on the atlas. Samples only give density; what colours a ray is decoded once, from their mean.

    Along each ray the samples' features are composited, and a decoder turns their mean into colour: its cost does not
    grow with the samples (deferred shading, as Hedman et al. 2021, "Baking Neural Radiance Fields").

    One plane holds relief: offsets of the surface's normal in the canonical hand's axes, which the surface's rotation
    turns into the world before the decoder sees them. So tendons, creases and nails are lit right however the hand is
    held, where a decoder of features alone can only learn their mean shading.
    """

    VIEW_CHANNELS = 5

    def __init__(self, config: FieldConfig):
        super().__init__()
        self.config = config
        self.planes = nn.ModuleList(FeaturePlane(*size) for size in config.planes)
        self.relief = FeaturePlane(config.relief, 1, 3)
        self.light = nn.Linear(DIRECTIONS, EXPOSURE_CHANNELS)
        near = sum(channels for _, _, channels in config.planes) + 2 + LOCAL_POSE_CHANNELS
        self.near = nn.Linear(near, config.density_width)
        self.density = nn.Linear(config.density_width, 1)
        self.normal_slice = slice(near + 3, near + 6)
        self.gathered_channels = near + 3 + 3 + EXPOSURE_CHANNELS
        decoded = self.gathered_channels + self.VIEW_CHANNELS
        first = nn.Linear(decoded, config.width)
        self.trunk = nn.ModuleList([first, nn.Linear(config.width, config.width)])
        self.channels = nn.Linear(config.width, CHANNELS)
        if not config.pose:
            for layer in (self.near, first):
                _deafen(layer.weight, slice(near - LOCAL_POSE_CHANNELS, near))

    def exposure(self, visibility: Float[Tensor, "V K"]) -> Float[Tensor, "V 8"]:
        """Light each vertex gets in the training's light, as a code learnt along with everything else."""
        return self.light(visibility)

    def forward(self, inputs: FieldInputs, steps: Steps) -> Composite:
        """Volume-rendered channels [R, 32], premultiplied."""
        height = inputs.height[:, None]
        near = torch.cat([*self._read(inputs), height, height**2, inputs.local_pose], -1)
        sigma = _density(self.density(relu(self.near(near)))[:, 0], inputs.height)
        told = torch.cat([near, inputs.normal, self._relief_normal(inputs), inputs.exposure], -1)
        return self.decode(composite(sigma, told, steps), inputs.view)

    def decode(self, told: Composite, view: Float[Tensor, "R 3"]) -> Composite:
        """Colour and features of rays, from what was composited along each and its unit direction, world."""
        mean = told.channels / told.alpha.clamp(min=_MIN_ALPHA)[:, None]
        normal = torch.nn.functional.normalize(mean[:, self.normal_slice], dim=-1)
        hidden = torch.cat([mean, view_features(normal, view)], -1)
        for layer in self.trunk:
            hidden = relu(layer(hidden), inplace=True)
        return told._replace(channels=_channels(self.channels(hidden)) * told.alpha[:, None])

    def _relief_normal(self, inputs: FieldInputs) -> Float[Tensor, "S 3"]:
        """The posed normal with the relief's offset, unit length, world."""
        offset = self.relief(inputs.uv, inputs.height, RELIEF_GAIN * self.fade(self.relief, inputs.footprint_m))
        turned = (inputs.rotation * offset[:, None, :]).sum(-1)
        return torch.nn.functional.normalize(inputs.normal + turned, dim=-1)

    def _read(self, inputs: FieldInputs) -> list[Tensor]:
        planes = [plane for plane in self.planes if isinstance(plane, FeaturePlane)]
        return [plane(inputs.uv, inputs.height, self.fade(plane, inputs.footprint_m)) for plane in planes]

    def fade(self, plane: FeaturePlane, footprint_m: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
        """1, less for planes finer than a pixel at the sample, which would shimmer."""
        texel_m = self.config.atlas_m / plane.resolution
        return (2 * texel_m / footprint_m).clamp(max=1)


def _deafen(weight: Tensor, inputs: slice) -> None:
    """Make a layer's weights of some inputs zero, now and in training."""
    heard = torch.ones_like(weight)
    heard[:, inputs] = 0
    with torch.no_grad():
        weight *= heard
    weight.register_hook(lambda gradient: gradient * heard.to(gradient.device))


def _density(logit: Tensor, height: Tensor) -> Tensor:
    return softplus(logit.float() + PRIOR_SLOPE * height + PRIOR_OFFSET)


def _channels(raw: Tensor) -> Tensor:
    """Colour through a sigmoid; features as they are."""
    return torch.cat([raw[:, :3].sigmoid(), raw[:, 3:]], -1)
