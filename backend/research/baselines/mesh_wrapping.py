"""Explicit baselines: a texture from photographs on the posed mesh, nothing else (paper section 4.2).

`MeshWrapping("mesh_wrapping")` is the paper's: the texture of the training pose nearest to flat. `mesh_texture`, ours
and kinder, takes the same weighted mean over all training views, which is the least-squares texture; it is also what a
static texture, as HTML and NIMBLE have one, comes to with one person's data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
import torch
from torch import Tensor

from ...capture.capture import Capture, CaptureView
from ...evaluation.contact_sheet import save_sheet
from ...evaluation.shot_renderer import no_stage
from ...hand.model import HandModel
from ...image.decode import decode_frame
from ...records.frame import Frame, empty_frame
from ...records.render_hooks import OnStage
from ...records.shot import HandPose, Shot
from .method import Budget, Fitted, FittingMachine
from .posed_views import PosedViews, ShotMeshes
from .texture import RESOLUTION, TextureSum, draw_textured, texels_of
from .weights_file import load_method, save_method

PICTURE_FILE = "texture.png"


@dataclass(frozen=True)
class MeshWrapping:
    """One of the two explicit methods.

    Attributes:
        name: `mesh_wrapping` or `mesh_texture`.
        label: in the tables.
        is_flat_only: whether only the flattest training pose is seen.
        notes: below the table.
        resolution: of the texture.
    """

    name: str
    label: str
    is_flat_only: bool
    notes: str
    tables: tuple[str, ...] = ("comparison",)
    version: int = 1
    resolution: int = RESOLUTION

    def fit(self, capture: Capture, hand: HandModel, budget: Budget, folder: Path, machine: FittingMachine) -> Fitted:
        """Pass once over the views; as short as it is, it is not resumed but repeated.

        Beside the method's own file, the texture is written as a picture that the hand's mesh can wear in Blender.
        """
        began = process_time()
        views = PosedViews(capture, hand, machine.device)
        chosen = range(len(views))
        if self.is_flat_only:
            flattest = flattest_pose(capture.poses, views.views)
            chosen = [index for index in chosen if views.views[index].pose_index == flattest]
        total = TextureSum(texels_of(views.topology, self.resolution), views.topology)
        for index in chosen:
            window = views.window(index)
            total.add(window.target, window.mesh, window.camera)
        template = torch.as_tensor(hand.v_template, dtype=torch.float32, device=machine.device)
        texture, filled = total.finished(template)
        facts = {"views": len(chosen), "filled_share": round(filled, 4)}
        save_method(folder, self.name, {"texture": texture.half()}, facts)
        save_sheet(as_picture(texture), folder / PICTURE_FILE)
        seconds = process_time() - began
        remarks = f"{len(chosen)} views; {100 * filled:.1f} % of the atlas was seen by none and is filled"
        return Fitted(0, seconds / 60, 3 * self.resolution**2, remarks)

    def load(self, folder: Path, hand: HandModel, device: torch.device) -> TexturedMesh:
        """Load the textured mesh."""
        tensors, _ = load_method(folder, self.name)
        return TexturedMesh(hand, tensors["texture"].float().to(device), device)


class TexturedMesh:
    """Draws the mesh with a texture [N, N, 3].

    Attributes:
        hand: the model of its shots.
    """

    def __init__(self, hand: HandModel, texture: Tensor, device: torch.device):
        self.hand, self._texture, self._meshes = hand, texture, ShotMeshes(hand, device)

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
        picture, depth = draw_textured(self._texture, mesh, topology, camera)
        on_stage("decode")
        return decode_frame(picture, depth, crop, shot.camera.size_px)


def as_picture(texture: Tensor) -> np.ndarray:
    """Return [N, N, 3] uint8 with v upwards, as Blender and most programs have textures."""
    return (texture.flip(0).clamp(0, 1) * 255).round().byte().cpu().numpy()


def flattest_pose(poses: Sequence[HandPose], views: Sequence[CaptureView]) -> int:
    """Choose the pose, among those of the views, whose 15 finger joints are bent least from the template, rms."""
    seen = sorted({view.pose_index for view in views})
    bends = [float(np.sqrt((poses[index].theta[1:] ** 2).sum(1).mean())) for index in seen]
    return seen[int(np.argmin(bends))]


MESH_WRAPPING = MeshWrapping(
    "mesh_wrapping",
    "Mesh wrapping",
    True,
    "The texture (1024 x 1024) of the training pose nearest to the template's, whose shading stays in it; what none of "
    "that pose's views saw has the colour of the nearest seen skin. Resolution, blending and filling are our choices.",
)
MESH_TEXTURE = MeshWrapping(
    "mesh_texture",
    "Least-squares texture (ours)",
    False,
    "Not in the paper: the same over all training views, the kindest static texture on this mesh.",
)
