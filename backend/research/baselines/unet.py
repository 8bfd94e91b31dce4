"""The U-Net of SMPLpix: five levels, two convolutions each, skips by concatenation; sizes as its author published."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import max_pool2d, pad

LEVELS = 5
_STRIDE = 2 ** (LEVELS - 1)


class UNet(nn.Module):
    """Images of any size; they are padded to multiples of 16 px inside.

    Args:
        inputs: channels.
        outputs: channels, through a sigmoid.
        width: of the first level; it doubles with each.
    """

    def __init__(self, inputs: int, outputs: int, width: int):
        super().__init__()
        widths = [width * 2**level for level in range(LEVELS)]
        self.down = nn.ModuleList(_two(a, b) for a, b in zip([inputs, *widths[:-1]], widths, strict=True))
        coarse, fine = widths[:0:-1], widths[-2::-1]
        self.up = nn.ModuleList(_one(a, b) for a, b in zip(coarse, fine, strict=True))
        self.join = nn.ModuleList(_two(2 * b, b) for b in fine)
        self.last = nn.Conv2d(width, outputs, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.xavier_normal_(module.weight)

    def forward(self, image: Float[Tensor, "B C H W"]) -> Float[Tensor, "B D H W"]:
        """Compute the picture, in [0, 1]."""
        height, width = image.shape[2:]
        hidden = pad(image, (0, -width % _STRIDE, 0, -height % _STRIDE))
        skips = []
        for level, block in enumerate(self.down):
            hidden = block(max_pool2d(hidden, 2) if level else hidden)
            skips.append(hidden)
        for up, join, skip in zip(self.up, self.join, skips[-2::-1], strict=True):
            larger = nn.functional.interpolate(hidden, scale_factor=2, mode="bilinear", align_corners=False)
            hidden = join(torch.cat([up(larger), skip], 1))
        return self.last(hidden).sigmoid()[:, :, :height, :width]


def _one(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(inputs, outputs, 3, padding=1), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


def _two(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(*_one(inputs, outputs), *_one(outputs, outputs))
