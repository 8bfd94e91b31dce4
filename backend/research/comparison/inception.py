"""Inception of 2015-12-05 up to its 2048 pooled features: the network of published FIDs (Heusel et al. 2017).

Its weights are not distributed with LiveHand: users name the file `pt_inception-2015-12-05-6726825d.pth`. The layers
have torchvision's names; what differs from torchvision's network is that means do not count the padding, and that the
last block pools by the maximum.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, max_pool2d

from ...evaluation.perceptual.weights import read_weights
from ...records.errors import LiveHandError

FEATURES = 2048
_FILE = "pt_inception-2015-12-05-6726825d.pth, a release file of mseitzer/pytorch-fid"
_SIDE_PX = 299

Side = int | tuple[int, int]


class BasicConv2d(nn.Module):
    """Convolution, batch normalisation, ReLU."""

    def __init__(self, inputs: int, outputs: int, side: Side, stride: int = 1, padding: Side = 0):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, side, stride, padding, bias=False)
        self.bn = nn.BatchNorm2d(outputs, eps=0.001)

    def forward(self, x: Tensor) -> Tensor:
        """Apply ReLU to the normalised convolution."""
        return self.bn(self.conv(x)).relu()


class _Block(nn.Module):
    """Branches side by side; a branch is a chain of layer names, or `pool` and a layer, or several ends of a chain."""

    def __init__(self, layers: dict[str, BasicConv2d]):
        super().__init__()
        for name, layer in layers.items():
            self.add_module(name, layer)

    def chain(self, x: Tensor, *names: str) -> Tensor:
        for name in names:
            x = self.get_submodule(name)(x)
        return x


class _BlockA(_Block):
    def __init__(self, inputs: int, pooled: int):
        conv = BasicConv2d
        super().__init__(
            {
                "branch1x1": conv(inputs, 64, 1),
                "branch5x5_1": conv(inputs, 48, 1),
                "branch5x5_2": conv(48, 64, 5, padding=2),
                "branch3x3dbl_1": conv(inputs, 64, 1),
                "branch3x3dbl_2": conv(64, 96, 3, padding=1),
                "branch3x3dbl_3": conv(96, 96, 3, padding=1),
                "branch_pool": conv(inputs, pooled, 1),
            }
        )

    def forward(self, x: Tensor) -> Tensor:
        five = self.chain(x, "branch5x5_1", "branch5x5_2")
        three = self.chain(x, "branch3x3dbl_1", "branch3x3dbl_2", "branch3x3dbl_3")
        return torch.cat([self.chain(x, "branch1x1"), five, three, self.chain(_mean(x), "branch_pool")], 1)


class _BlockB(_Block):
    def __init__(self, inputs: int):
        conv = BasicConv2d
        super().__init__(
            {
                "branch3x3": conv(inputs, 384, 3, 2),
                "branch3x3dbl_1": conv(inputs, 64, 1),
                "branch3x3dbl_2": conv(64, 96, 3, padding=1),
                "branch3x3dbl_3": conv(96, 96, 3, 2),
            }
        )

    def forward(self, x: Tensor) -> Tensor:
        double = self.chain(x, "branch3x3dbl_1", "branch3x3dbl_2", "branch3x3dbl_3")
        return torch.cat([self.chain(x, "branch3x3"), double, max_pool2d(x, 3, 2)], 1)


class _BlockC(_Block):
    def __init__(self, inputs: int, width: int):
        conv = BasicConv2d
        super().__init__(
            {
                "branch1x1": conv(inputs, 192, 1),
                "branch7x7_1": conv(inputs, width, 1),
                "branch7x7_2": conv(width, width, side=(1, 7), padding=(0, 3)),
                "branch7x7_3": conv(width, 192, side=(7, 1), padding=(3, 0)),
                "branch7x7dbl_1": conv(inputs, width, 1),
                "branch7x7dbl_2": conv(width, width, side=(7, 1), padding=(3, 0)),
                "branch7x7dbl_3": conv(width, width, side=(1, 7), padding=(0, 3)),
                "branch7x7dbl_4": conv(width, width, side=(7, 1), padding=(3, 0)),
                "branch7x7dbl_5": conv(width, 192, side=(1, 7), padding=(0, 3)),
                "branch_pool": conv(inputs, 192, 1),
            }
        )

    def forward(self, x: Tensor) -> Tensor:
        seven = self.chain(x, *(f"branch7x7_{k}" for k in (1, 2, 3)))
        double = self.chain(x, *(f"branch7x7dbl_{k}" for k in (1, 2, 3, 4, 5)))
        return torch.cat([self.chain(x, "branch1x1"), seven, double, self.chain(_mean(x), "branch_pool")], 1)


class _BlockD(_Block):
    def __init__(self, inputs: int):
        conv = BasicConv2d
        super().__init__(
            {
                "branch3x3_1": conv(inputs, 192, 1),
                "branch3x3_2": conv(192, 320, 3, 2),
                "branch7x7x3_1": conv(inputs, 192, 1),
                "branch7x7x3_2": conv(192, 192, (1, 7), padding=(0, 3)),
                "branch7x7x3_3": conv(192, 192, (7, 1), padding=(3, 0)),
                "branch7x7x3_4": conv(192, 192, 3, 2),
            }
        )

    def forward(self, x: Tensor) -> Tensor:
        seven = self.chain(x, *(f"branch7x7x3_{k}" for k in (1, 2, 3, 4)))
        return torch.cat([self.chain(x, "branch3x3_1", "branch3x3_2"), seven, max_pool2d(x, 3, 2)], 1)


class _BlockE(_Block):
    def __init__(self, inputs: int, pool: Callable[[Tensor], Tensor]):
        conv = BasicConv2d
        super().__init__(
            {
                "branch1x1": conv(inputs, 320, 1),
                "branch3x3_1": conv(inputs, 384, 1),
                "branch3x3_2a": conv(384, 384, side=(1, 3), padding=(0, 1)),
                "branch3x3_2b": conv(384, 384, side=(3, 1), padding=(1, 0)),
                "branch3x3dbl_1": conv(inputs, 448, 1),
                "branch3x3dbl_2": conv(448, 384, 3, padding=1),
                "branch3x3dbl_3a": conv(384, 384, side=(1, 3), padding=(0, 1)),
                "branch3x3dbl_3b": conv(384, 384, side=(3, 1), padding=(1, 0)),
                "branch_pool": conv(inputs, 192, 1),
            }
        )
        self._pool = pool

    def forward(self, x: Tensor) -> Tensor:
        three = self.chain(x, "branch3x3_1")
        double = self.chain(x, "branch3x3dbl_1", "branch3x3dbl_2")
        ends = [self.chain(three, f"branch3x3_2{end}") for end in "ab"]
        ends += [self.chain(double, f"branch3x3dbl_3{end}") for end in "ab"]
        return torch.cat([self.chain(x, "branch1x1"), *ends, self.chain(self._pool(x), "branch_pool")], 1)


class InceptionFeatures(nn.Module):
    """The network: 21,785,568 parameters; images of any size are enlarged to 299 x 299 px."""

    def __init__(self):
        super().__init__()
        conv = BasicConv2d
        self.Conv2d_1a_3x3, self.Conv2d_2a_3x3 = conv(3, 32, 3, 2), conv(32, 32, 3)
        self.Conv2d_2b_3x3 = conv(32, 64, 3, padding=1)
        self.Conv2d_3b_1x1, self.Conv2d_4a_3x3 = conv(64, 80, 1), conv(80, 192, 3)
        self.Mixed_5b, self.Mixed_5c, self.Mixed_5d = _BlockA(192, 32), _BlockA(256, 64), _BlockA(288, 64)
        self.Mixed_6a = _BlockB(288)
        self.Mixed_6b, self.Mixed_6c = _BlockC(768, 128), _BlockC(768, 160)
        self.Mixed_6d, self.Mixed_6e = _BlockC(768, 160), _BlockC(768, 192)
        self.Mixed_7a = _BlockD(768)
        self.Mixed_7b, self.Mixed_7c = _BlockE(1280, _mean), _BlockE(2048, _maximum)
        self.eval().requires_grad_(False)

    def forward(self, image: Float[Tensor, "B 3 H W"]) -> Float[Tensor, "B 2048"]:
        """Compute features of sRGB-encoded images in [0, 1]."""
        x = 2 * interpolate(image, (_SIDE_PX, _SIDE_PX), mode="bilinear", align_corners=False) - 1
        for name, layer in self.named_children():
            if name in ("Conv2d_3b_1x1", "Mixed_5b"):
                x = max_pool2d(x, 3, 2)
            x = layer(x)
        return x.mean((2, 3))


def load_inception(path: Path) -> InceptionFeatures:
    """Load the network with the weights of a file.

    Raises:
        LiveHandError: the file is missing, or of another network.
    """
    weights = read_weights(path, _FILE)
    network = InceptionFeatures()
    kept = {name: value for name, value in weights.items() if not name.startswith(("fc.", "AuxLogits."))}
    try:
        missing, unexpected = network.load_state_dict(kept, strict=False)
    except RuntimeError as error:
        raise LiveHandError(f"FID needs {_FILE}, got other sizes in {path} ({error})") from error
    missing = [name for name in missing if not name.endswith("num_batches_tracked")]
    if missing or unexpected:
        raise LiveHandError(f"FID needs {_FILE}, got another network in {path}: no {(missing + unexpected)[0]} in both")
    return network


def _mean(x: Tensor) -> Tensor:
    return avg_pool2d(x, 3, 1, 1, count_include_pad=False)


def _maximum(x: Tensor) -> Tensor:
    return max_pool2d(x, 3, 1, 1)
