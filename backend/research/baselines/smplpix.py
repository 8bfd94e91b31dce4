"""SMPLpix: a drawing of the mesh goes through a U-Net (Prokudin et al., WACV 2021), with the mesh as the paper has it.

Which channels the paper draws and which loss it takes is stated nowhere. Here the drawing holds the surface's normal in
the camera's axes and, if asked for, its place on the template; the network returns colour on black, and alpha.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import affine_grid, avg_pool2d, grid_sample, max_pool2d, pad

from ...capture.capture import Capture
from ...compute.precision import autocast
from ...evaluation.shot_renderer import no_stage
from ...field.rays import CameraTensors
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.uvh import interpolate
from ...hand.model import HandModel
from ...image.decode import decode_frame
from ...records.frame import Frame, empty_frame
from ...records.render_hooks import OnStage
from ...records.shot import Shot
from ...training.config import LossConfig, TrainConfig
from ...training.losses import crop_loss
from ...training.schedule import ScheduleState
from .drawing import depth_map, drawn_surface, normal_map
from .fitting import fit_network, identity_of
from .method import Budget, Fitted, FittingMachine
from .posed_views import PosedViews, ShotMeshes
from .weights_file import load_network, parameter_count, save_method

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


Drawing = Literal["shaded", "surface"]
"""`shaded`: the normal. `surface`: the place on the template too."""

BATCH, CROP_PX = 4, 160
_STEP_SHARE = 0.5  # four crops a step: twice the images of the avatars' rows
_TURNED_SHARE, _MAX_TURN_RAD, _SCALES, _MAX_MOVE_PX = 0.8, pi / 3, (0.5, 1.5), 100
_PLACE_M = 0.1  # unit of positions on the template
_LOSS = LossConfig(low_l2=0.0, perceptual_share=1.0, perceptual_rise=0.0)


@dataclass(frozen=True)
class SmplPix:
    """The method.

    Attributes:
        width: of the U-Net's first level.
        drawing: what the network sees.
    """

    name: str = "smplpix"
    label: str = "SMPLpix"
    tables: tuple[str, ...] = ("comparison",)
    version: int = 1
    width: int = 16
    drawing: Drawing = "shaded"

    @property
    def notes(self) -> str:
        """Below the table."""
        return (
            f"Our re-implementation by its author's published sizes, {self.width} wide instead of 32, on the mesh's "
            "normals; colour and alpha; the avatars' loss with VGG19 from the first step; each step sees four crops of "
            "160 x 160 px, turned, scaled and moved as published, in half the steps; cosine decay."
        )

    def fit(self, capture: Capture, hand: HandModel, budget: Budget, folder: Path, machine: FittingMachine) -> Fitted:
        """Train the U-Net."""
        views = PosedViews(capture, hand, machine.device)
        config = budget.train_config(_STEP_SHARE, learning_rate=1e-3, seed=machine.seed, loss=_LOSS)
        network = self._network(machine.seed).to(machine.device)
        batches = _Batches(views, self.drawing, machine.seed)

        def step_loss(state: ScheduleState) -> tuple[Tensor, tuple[str, ...]]:
            drawings, targets, is_inside, files = batches.at(state.step)
            with autocast(machine.device, machine.compute.precision):
                images = network(drawings).float()
                return _loss(images, targets, is_inside, config, machine), files

        identity = identity_of(capture, config, views.views, f"{self.name} {self.width} {self.drawing}", self.version)
        progress = fit_network(network, step_loss, config, folder, identity, self.name)
        save_method(folder, self.name, network.state_dict())
        return Fitted(progress.step, progress.seconds / 60, parameter_count(network))

    def load(self, folder: Path, hand: HandModel, device: torch.device) -> DrawnHand:
        """Load the trained method."""
        network = load_network(folder, self.name, self._network(0)).to(device)
        return DrawnHand(hand, network, self.drawing, device)

    def _network(self, seed: int) -> UNet:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return UNet(3 if self.drawing == "shaded" else 6, 4, self.width)


class DrawnHand:
    """Draws the mesh and sends it through the network.

    Attributes:
        hand: the model of its shots.
    """

    def __init__(self, hand: HandModel, network: torch.nn.Module, drawing: Drawing, device: torch.device):
        self.hand, self._network = hand, network
        self._drawing: Drawing = drawing
        self._meshes = ShotMeshes(hand, device)
        self._template = torch.as_tensor(hand.v_template, dtype=torch.float32, device=device)

    @torch.inference_mode()
    def render(self, shot: Shot, *, on_stage: OnStage = no_stage) -> Frame:
        """Render as `ShotRenderer` does."""
        on_stage("pose")
        mesh, topology = self._meshes.mesh(shot)
        window = self._meshes.window(shot, mesh)
        if window is None:
            return empty_frame(shot.camera.size_px)
        crop, camera = window
        on_stage("rasterise")
        drawing, depth = draw(mesh, topology, camera, self._template, self._drawing)
        on_stage("superres")
        image = self._network(drawing[None])[0]
        on_stage("decode")
        return decode_frame(image, depth, crop, shot.camera.size_px)


def draw(
    mesh: PosedMesh, topology: Topology, camera: CameraTensors, template: Float[Tensor, "V 3"], drawing: Drawing
) -> tuple[Float[Tensor, "C H W"], Float[Tensor, "H W"]]:
    """Draw the network's input, and depth."""
    surface = drawn_surface(mesh, topology, camera)
    image, depth = normal_map(mesh, topology, camera, surface), depth_map(surface, camera.size_px)
    if drawing == "surface":
        place = interpolate(template / _PLACE_M, topology, surface.samples)
        width, height = camera.size_px
        flat = place.new_zeros(height * width, 3).index_put((surface.pixel,), place)
        image = torch.cat([image, flat.T.reshape(3, height, width)])
    return image, depth


class _Batches:
    """The crops of each step: functions of seed and step alone."""

    def __init__(self, views: PosedViews, drawing: Drawing, seed: int):
        self._views, self._seed = views, seed
        self._drawing: Drawing = drawing
        self._template = torch.as_tensor(views.hand.v_template, dtype=torch.float32, device=views.device)
        self._drawn: dict[int, Tensor] = {}

    def at(self, step: int) -> tuple[Tensor, Tensor, Tensor, tuple[str, ...]]:
        """Return drawings [B, C, S, S], targets [B, 4, S, S], which pixels they cover [B, S, S], and the files."""
        generator = torch.Generator().manual_seed(self._seed * 1_000_003 + step)
        chosen = torch.randint(len(self._views), (BATCH,), generator=generator).tolist()
        parts = [self._crop(index, generator) for index in chosen]
        files = tuple(self._views.views[index].file for index in chosen)
        drawings, targets, insides = (torch.stack(side) for side in zip(*parts, strict=True))
        return drawings, targets, insides, files

    def _crop(self, index: int, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        window = self._views.window(index)
        if index not in self._drawn:
            drawn, _ = draw(window.mesh, self._views.topology, window.camera, self._template, self._drawing)
            self._drawn[index] = drawn.half()
        drawing = self._drawn[index].float()
        stack = torch.cat([drawing, window.target * window.is_inside, window.is_inside[None].float()])
        turn_rad, scale, move_px = _augmentation(generator)
        moved = turned(stack, turn_rad, scale, move_px, CROP_PX)
        channels = len(drawing)
        drawing, target, inside = moved[:channels], moved[channels:-1], moved[-1] > 0.999
        x, y = drawing[0].clone(), drawing[1].clone()
        drawing[0], drawing[1] = cos(turn_rad) * x - sin(turn_rad) * y, sin(turn_rad) * x + cos(turn_rad) * y
        return drawing, target, inside


def _augmentation(generator: torch.Generator) -> tuple[float, float, tuple[float, float]]:
    """Draw (turn, scale, move) with the published probability; otherwise none but a small move."""
    is_turned, *uniform = torch.rand(5, generator=generator).tolist()
    a, b, x, y = (2 * value - 1 for value in uniform)
    if is_turned >= _TURNED_SHARE:
        return 0.0, 1.0, (CROP_PX / 4 * x, CROP_PX / 4 * y)
    low, high = _SCALES
    return _MAX_TURN_RAD * a, low + (high - low) * (b + 1) / 2, (_MAX_MOVE_PX * x, _MAX_MOVE_PX * y)


def turned(
    image: Float[Tensor, "C H W"], turn_rad: float, scale: float, move_px: tuple[float, float], side_px: int
) -> Float[Tensor, "C S S"]:
    """Turn the image clockwise by an angle, scale and move it about its middle, and cut a square; zero beyond it."""
    height, width = image.shape[1:]
    c, s = cos(turn_rad) / scale, sin(turn_rad) / scale
    half = side_px / 2
    x = (c * half, s * half, -(c * move_px[0] + s * move_px[1]))
    y = (-s * half, c * half, -(-s * move_px[0] + c * move_px[1]))
    rows = [[value / (width / 2) for value in x], [value / (height / 2) for value in y]]
    grid = affine_grid(image.new_tensor([rows]), [1, len(image), side_px, side_px], align_corners=False)
    return grid_sample(image[None], grid, align_corners=False)[0]


def _loss(
    images: Float[Tensor, "B 4 H W"],
    targets: Float[Tensor, "B 4 H W"],
    is_inside: Tensor,
    config: TrainConfig,
    machine: FittingMachine,
) -> Tensor:
    """Compute the avatars' loss, mean over the crops; its low resolution is the picture's own mean."""
    low = avg_pool2d(images, 2)
    parts = zip(low, images, targets, is_inside, strict=True)
    terms = [crop_loss(*part, config.loss, machine.perceptual).total for part in parts]
    return torch.stack(terms).mean()


SMPLPIX = SmplPix()
