"""What a rendered window is compared by: colour, alpha, and perceptual features, at both resolutions."""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

from .config import LossConfig
from .perceptual import PerceptualLoss


def window_loss(
    low: Float[Tensor, "4 h w"],
    image: Float[Tensor, "4 H W"],
    target: Float[Tensor, "4 H W"],
    is_inside: Bool[Tensor, "H W"],
    config: LossConfig,
    perceptual: PerceptualLoss | None,
) -> Float[Tensor, ""]:
    """The training loss of one window.

    Args:
        low: RGBA before super-resolution.
        image: RGBA after it, not clamped.
        target: ground truth; its 2 x 2 means are the low-resolution truth, as the grids share their corners.
        is_inside: which pixels the ground truth covers; the rest of the window counts nothing.
        config: weights.
        perceptual: None leaves the term out.
    """
    error = (image - target) * is_inside
    low_target = avg_pool2d(target[None], 2)[0]
    low_inside = avg_pool2d(is_inside[None].float(), 2)[0] == 1
    low_error = (low - low_target) * low_inside
    loss = (
        config.colour_l2 * (error[:3] ** 2).mean()
        + config.colour_l1 * error[:3].abs().mean()
        + config.alpha_l2 * (error[3] ** 2).mean()
        + config.low_l2 * (low_error**2).mean()
    )
    if perceptual is None:
        return loss
    full = perceptual((image[:3] * is_inside)[None], (target[:3] * is_inside)[None])
    half = perceptual((low[:3] * low_inside)[None], (low_target[:3] * low_inside)[None])
    return loss + config.perceptual * (full + half)
