"""The radiance field H(u, v, h, view, pose) -> (density, colour, features): the paper's, and one of feature planes.

Both volume-render 32 channels: colour (sRGB-encoded, [0, 1]) and 29 features for super-resolution. Densities are per
millimetre, which keeps the networks' outputs of order one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import relu, softplus

from ..light.visibility import DIRECTIONS
from .conditions import LIGHT_CHANNELS, LOCAL_POSE_CHANNELS, FieldInputs, view_features
from .encoding import FeaturePlane, PlaneReader, positional_encoding
from .volume import Composite, Steps, composite

FEATURE_CHANNELS = 29
CHANNELS = 3 + FEATURE_CHANNELS

# Prior of the density before training: opaque inside the surface, transparent outside.
PRIOR_SLOPE, PRIOR_OFFSET = -6.0, -1.0
# Keeps the mean finite along nearly transparent rays.
MIN_ALPHA = 1e-4
# Scales down the relief plane's learning rate: its useful values are a few tenths.
RELIEF_GAIN = 0.25


@dataclass(frozen=True)
class FieldConfig:
    """Which field, and its size."""

    kind: Literal["paper", "planes", "xyz", "bones"] = "planes"
    """`paper`: positional encoding and a 4 x 128 MLP, 92,577 parameters. `planes`: learned feature planes. The paper's
    ablations: `xyz`, an MLP of points in the world (`field.ablations`), and `bones`, one of points in each bone's frame
    (`field.ablations`)."""
    width: int = 192
    """Width of the decoder, which is queried once per ray."""
    density_width: int = 32
    """Width of the density layer, which is queried at every sample."""
    planes: tuple[tuple[int, int, int], ...] = ((64, 6, 8), (128, 3, 8), (256, 3, 8), (512, 1, 4))
    """(resolution, heights, channels) of each plane."""
    relief: int = 384
    """Resolution of the relief plane, a learnt normal map."""
    atlas_m: float = 0.27
    """Approximate length on the skin of one atlas unit; decides which planes are finer than a pixel."""
    pose: bool = True
    """Whether the field is conditioned on the local pose (False: the ablation)."""
    light: Literal["baked", "linear"] = "baked"
    """`baked`: colours in the light of the capture. `linear`: coefficients for any light (`field.relightable`)."""
    identities: tuple[str, ...] = ()
    """Of `paper`: names of the people whom one network shows, each by a code; empty: it shows one, without a code."""


POSITION_OCTAVES, VIEW_OCTAVES = 10, 4
"""Of the positional encodings of the paper's networks."""
CODE_SIZE = 8
"""Of an identity's code, as in the authors' released configuration."""
CODE_DEVIATION = 0.3  # of codes before training
POSITION_INPUTS, VIEW_INPUTS = 3 * (1 + 2 * POSITION_OCTAVES), 3 * (1 + 2 * VIEW_OCTAVES)


class MlpField(nn.Module):
    """A field without planes: an MLP at every sample.

    Attributes:
        asks: which coordinates of its samples it needs; `surface`: only those on the atlas.
    """

    asks: Literal["surface", "world", "bones"] = "surface"

    def light_code(self, visibility: Float[Tensor, "V K"]) -> Float[Tensor, "V 0"]:
        """Return no code: these fields have no input for self-shadowing."""
        return visibility[:, :0]

    def forward(self, inputs: FieldInputs, steps: Steps, read_plane: PlaneReader = FeaturePlane.forward) -> Composite:
        """Return volume-rendered channels [R, 32], premultiplied; there are no planes to read."""
        raise NotImplementedError


class PaperField(MlpField):
    """The paper's MLP (supplement; sizes as published), in corrected units: h in units of the shell.

    The first layer's product with the pose is the same for all samples of a frame and is computed once. So is that with
    the code of the identity that is shown, beside the pose.

    Attributes:
        codes: [N, 8] of the identities; None: there is one, without a code.
    """

    WIDTH = 128

    def __init__(self, has_pose: bool = True, identities: int = 0):
        super().__init__()
        width = self.WIDTH
        self.position = nn.Linear(POSITION_INPUTS, width)
        self.pose = nn.Linear(48, width, bias=False) if has_pose else None
        self.identity = nn.Linear(CODE_SIZE, width, bias=False) if identities else None
        self.codes = nn.Parameter(CODE_DEVIATION * torch.randn(identities, CODE_SIZE)) if identities else None
        self.trunk = nn.ModuleList(nn.Linear(width, width) for _ in range(3))
        self.density = nn.Linear(width, 1)
        self.bottleneck = nn.Linear(width, width)
        self.view = nn.Linear(width + VIEW_INPUTS, 64)
        self.channels = nn.Linear(64, CHANNELS)

    def forward(self, inputs: FieldInputs, steps: Steps, read_plane: PlaneReader = FeaturePlane.forward) -> Composite:
        """Return volume-rendered channels, as `MlpField`."""
        sigma, channels = self.ask(inputs, steps.t.shape[1])
        return composite(sigma, channels, steps)

    def ask(self, inputs: FieldInputs, per_ray: int) -> tuple[Float[Tensor, " S"], Float[Tensor, "S 32"]]:
        """Compute density per mm and channels at samples, of which each ray has so many."""
        uvh = torch.cat([inputs.uv, inputs.height[:, None]], -1)
        first = self.position(positional_encoding(uvh, POSITION_OCTAVES))
        if self.pose is not None:
            first = first + self.pose(inputs.theta)
        if self.identity is not None and self.codes is not None:
            first = first + self.identity(self.codes[inputs.identity])
        hidden = relu(first)
        for layer in self.trunk:
            hidden = relu(layer(hidden))
        sigma = _density(self.density(hidden)[:, 0], inputs.height)
        view = positional_encoding(inputs.view, VIEW_OCTAVES).repeat_interleave(per_ray, 0)
        seen = torch.cat([self.bottleneck(hidden), view], -1)
        return sigma, straight_channels(self.channels(relu(self.view(seen))))


class PlaneField(nn.Module):
    """Feature planes on the atlas; samples give density only, and appearance is decoded once per ray.

    The features gathered at a ray's samples are composited, and a decoder takes their mean, so that its cost does not
    grow with the samples (deferred shading, as Hedman et al. 2021, "Baking Neural Radiance Fields").

    One plane holds relief: offsets of the surface normal in the canonical hand's axes, which the surface's local
    rotation turns into the world before decoding. So tendons, creases and nails are shaded correctly in every pose,
    where a decoder of features alone learns only their mean shading.

    Attributes:
        near_channels: of the gathered features that determine the density, which come first.
        gathered_channels: of all gathered features: after those, the normal, the relief normal and `light_code`.
        trunk: the decoder's hidden layers.
        channels: its last.
    """

    trunk: nn.ModuleList
    channels: nn.Linear

    def __init__(self, config: FieldConfig, light_channels: int):
        super().__init__()
        self.config = config
        self.planes = nn.ModuleList(FeaturePlane(*size) for size in config.planes)
        self.relief = FeaturePlane(config.relief, 1, 3)
        self.near_channels = sum(channels for _, _, channels in config.planes) + 2 + LOCAL_POSE_CHANNELS
        self.near = nn.Linear(self.near_channels, config.density_width)
        self.density = nn.Linear(config.density_width, 1)
        self.gathered_channels = self.near_channels + 3 + 3 + light_channels
        if not config.pose:
            self._leave_out_pose(self.near)

    def light_code(self, visibility: Float[Tensor, "V K"]) -> Float[Tensor, "V E"]:
        """Compute what each vertex adds to the gathered features, from its visibility."""
        raise NotImplementedError

    def shaded(
        self, gathered: Composite, view: Float[Tensor, "R 3"], decoder: Callable[[Tensor], Tensor] | None = None
    ) -> Composite:
        """Shade rays of these unit directions, world, from their composited features, as volume rendering returns them.

        `decoder` is as `decoded`, which stands for None.
        """
        raise NotImplementedError

    def decoded(self, inputs: Float[Tensor, "R C"]) -> Float[Tensor, "R D"]:
        """Apply the decoder's layers."""
        hidden = inputs
        for layer in self.trunk:
            hidden = relu(layer(hidden), inplace=True)
        return self.channels(hidden)

    def forward(self, inputs: FieldInputs, steps: Steps, read_plane: PlaneReader = FeaturePlane.forward) -> Composite:
        """Volume-render the rays; see `shaded`."""
        height = inputs.height[:, None]
        features = [self._read(plane, inputs, read_plane) for plane in self.feature_planes]
        near = torch.cat([*features, height, height**2, inputs.local_pose], -1)
        sigma = _density(self.density(relu(self.near(near)))[:, 0], inputs.height)
        gathered = torch.cat([near, inputs.normal, self._relief_normal(inputs, read_plane), inputs.light], -1)
        return self.shaded(composite(sigma, gathered, steps), inputs.view)

    @property
    def feature_planes(self) -> list[FeaturePlane]:
        """The planes without the relief's."""
        return [plane for plane in self.planes if isinstance(plane, FeaturePlane)]

    @property
    def normal_slice(self) -> slice:
        """Where the gathered features hold the relief normal."""
        return slice(self.near_channels + 3, self.near_channels + 6)

    def _leave_out_pose(self, layer: nn.Linear) -> None:
        _mask_inputs(layer.weight, slice(self.near_channels - LOCAL_POSE_CHANNELS, self.near_channels))

    def _relief_normal(self, inputs: FieldInputs, read_plane: PlaneReader) -> Float[Tensor, "S 3"]:
        """Compute the posed normal with the relief's offset, unit length, world."""
        fade = RELIEF_GAIN * self.fade(self.relief, inputs.footprint_m)
        offset = read_plane(self.relief, inputs.uv, inputs.height, fade)
        turned = (inputs.rotation * offset[:, None, :]).sum(-1)
        return torch.nn.functional.normalize(inputs.normal + turned, dim=-1)

    def _read(self, plane: FeaturePlane, inputs: FieldInputs, read_plane: PlaneReader) -> Float[Tensor, "S C"]:
        return read_plane(plane, inputs.uv, inputs.height, self.fade(plane, inputs.footprint_m))

    def fade(self, plane: FeaturePlane, footprint_m: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
        """Return 1, or less for planes finer than a pixel at the sample, which would alias."""
        texel_m = self.config.atlas_m / plane.resolution
        return (2 * texel_m / footprint_m).clamp(max=1)


class BakedField(PlaneField):
    """A field of planes whose decoder returns colour and features, in the light of the capture."""

    VIEW_CHANNELS = 5

    def __init__(self, config: FieldConfig):
        super().__init__(config, LIGHT_CHANNELS)
        self.light = nn.Linear(DIRECTIONS, LIGHT_CHANNELS)
        first = nn.Linear(self.gathered_channels + self.VIEW_CHANNELS, config.width)
        self.trunk = nn.ModuleList([first, nn.Linear(config.width, config.width)])
        self.channels = nn.Linear(config.width, CHANNELS)
        if not config.pose:
            self._leave_out_pose(first)

    def light_code(self, visibility: Float[Tensor, "V K"]) -> Float[Tensor, "V 8"]:
        """Compute a learned code of the light that each vertex receives under the capture's illumination."""
        return self.light(visibility)

    def shaded(
        self, gathered: Composite, view: Float[Tensor, "R 3"], decoder: Callable[[Tensor], Tensor] | None = None
    ) -> Composite:
        """Decode the colour and features [R, 32] of rays, premultiplied."""
        mean = mean_features(gathered)
        normal = torch.nn.functional.normalize(mean[:, self.normal_slice], dim=-1)
        raw = (decoder or self.decoded)(torch.cat([mean, view_features(normal, view)], -1))
        return gathered._replace(channels=straight_channels(raw) * gathered.alpha[:, None])


def mean_features(gathered: Composite) -> Float[Tensor, "R K"]:
    """Compute the gathered features of rays, as means over their samples."""
    return gathered.channels / gathered.alpha.clamp(min=MIN_ALPHA)[:, None]


def _mask_inputs(weight: Tensor, inputs: slice) -> None:
    """Keep a layer's weights of some inputs at zero, now and in training."""
    mask = torch.ones_like(weight)
    mask[:, inputs] = 0
    with torch.no_grad():
        weight *= mask
    weight.register_hook(lambda gradient: gradient * mask.to(gradient.device))


def _density(logit: Tensor, height: Tensor) -> Tensor:
    return softplus(logit.float() + PRIOR_SLOPE * height + PRIOR_OFFSET)


def density_without_height(logit: Float[Tensor, " S"]) -> Float[Tensor, " S"]:
    """Compute density per mm of fields that do not know the height: the prior has only its offset."""
    return softplus(logit.float() + PRIOR_OFFSET)


def straight_channels(raw: Tensor) -> Tensor:
    """Pass colour through a sigmoid; features stay as they are."""
    return torch.cat([raw[:, :3].sigmoid(), raw[:, 3:]], -1)
