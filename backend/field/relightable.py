"""A relightable field of planes: it returns coefficients that any light multiplies (`light.lighting`), and no colours.

URHand (Chen et al. 2024) is linear in the light in the same way; its features come from the mesh, these from the rays.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import normalize, softplus

from ..light.lighting import COEFFICIENTS, RELIGHTABLE_FEATURES, AmbientOcclusion
from .field import FieldConfig, PlaneField, mean_features
from .volume import Composite


def clamp_min(values: Float[Tensor, "*n"], least: float) -> Float[Tensor, "*n"]:
    """Compute `values.clamp(min=least)`, through which gradients pass that raise what lies below.

    Else a coefficient that some light drives below the bound gets no gradient any more, and stays there for good.
    """
    return _ClampMin.apply(values, least)


class _ClampMin(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values: Tensor, least: float) -> Tensor:
        ctx.save_for_backward(values > least)
        return values.clamp(min=least)

    @staticmethod
    def backward(ctx, *gradients: Tensor) -> tuple[Tensor, None]:
        (is_above,), (gradient,) = ctx.saved_tensors, gradients
        return gradient * (is_above | (gradient < 0)), None  # training goes against the gradient


# Coefficients before training, as arguments of softplus: ambient, deep scattered, less deep scattered and diffuse light
# (RGB each), and gloss. Red light goes deepest.
_START = (-2.0, -2.0, -2.0, -1.5, -3.5, -4.5, -2.0, -1.5, -2.0, -1.5, -1.5, -1.5, 0.0, 0.0)
# The least of these arguments: of the coefficient next to nothing is left, of softplus' slope enough to come back.
_LEAST = -8.0


class RelightableField(PlaneField):
    """A field of planes whose decoder returns coefficients and features.

    The decoder sees no direction of the world: only angles between normals, view and the open side of the skin. So a
    hand looks the same however it is turned together with its light.
    """

    ANGLES = 7

    def __init__(self, config: FieldConfig):
        super().__init__(config, light_channels=0)
        first = nn.Linear(self.near_channels + self.ANGLES, config.width)
        self.trunk = nn.ModuleList([first, nn.Linear(config.width, config.width)])
        self.channels = nn.Linear(config.width, COEFFICIENTS + RELIGHTABLE_FEATURES)
        if not config.pose:
            self._leave_out_pose(first)
        with torch.no_grad():
            self.channels.bias[:COEFFICIENTS] = torch.tensor(_START)

    def light_code(self, visibility: Float[Tensor, "V K"]) -> Float[Tensor, "V 0"]:
        """Return no code: shadows come with the light."""
        return visibility[:, :0]

    def shaded(
        self, gathered: Composite, view: Float[Tensor, "R 3"], decoder: Callable[[Tensor], Tensor] | None = None
    ) -> Composite:
        """Return the gathered features as they are: `decode` needs the ambient occlusion, which is not known here."""
        return gathered

    def decode(
        self,
        gathered: Composite,
        view: Float[Tensor, "R 3"],
        occlusion: AmbientOcclusion,
        decoder: Callable[[Tensor], Tensor] | None = None,
        inputs: RelightableInputs | None = None,
    ) -> Composite:
        """Decode coefficients (not negative) and features [R, 14 + 16] of rays, premultiplied.

        Args:
            gathered: as `forward` returns it.
            view: unit directions, world.
            occlusion: of the points that the rays meet, for their normals.
            decoder: as `decoded`, which stands for None.
            inputs: as `decoder_inputs`, which stands for None.
        """
        raw = (decoder or self.decoded)(
            (inputs or RelightableField.decoder_inputs)(self, gathered, view, occlusion)
        ).float()
        channels = torch.cat([softplus(clamp_min(raw[:, :COEFFICIENTS], _LEAST)), raw[:, COEFFICIENTS:]], -1)
        return gathered._replace(channels=channels * gathered.alpha[:, None])

    def decoder_inputs(self, gathered: Composite, view: Float[Tensor, "R 3"], occlusion: AmbientOcclusion) -> Tensor:
        """Compute the decoder's inputs for rays: mean features near the skin, and angles."""
        mean = mean_features(gathered)
        normal, relief_normal = (normalize(values, dim=-1) for values in self.normals(mean))
        return torch.cat([mean[:, : self.near_channels], _angles(normal, relief_normal, view, occlusion)], -1)

    def normals(self, mean: Float[Tensor, "R K"]) -> tuple[Float[Tensor, "R 3"], Float[Tensor, "R 3"]]:
        """Return the mesh's normal and the relief normal among gathered features, not of unit length."""
        at = self.near_channels
        return mean[:, at : at + 3], mean[:, self.normal_slice]


RelightableInputs = Callable[[RelightableField, Composite, Tensor, AmbientOcclusion], Tensor]
"""`RelightableField.decoder_inputs`, or what equals it."""


def _angles(
    normal: Float[Tensor, "R 3"],
    relief_normal: Float[Tensor, "R 3"],
    view: Float[Tensor, "R 3"],
    occlusion: AmbientOcclusion,
) -> Float[Tensor, "R 7"]:
    facing, relief_facing = -(normal * view).sum(-1), -(relief_normal * view).sum(-1)
    return torch.stack(
        [
            facing,
            relief_facing,
            (1 - relief_facing.clamp(0, 1)) ** 5,
            (normal * relief_normal).sum(-1),
            occlusion.share,
            (occlusion.towards * relief_normal).sum(-1),
            -(occlusion.towards * view).sum(-1),
        ],
        -1,
    )
