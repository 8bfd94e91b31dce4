"""Renders a capture: the main road, resumable at any moment."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import bpy
from PIL import Image
from tqdm import tqdm

from ...backend.capture import Capture, CaptureView, index_document, save_capture_index
from ...backend.errors import LiveHandError
from ...backend.hand.builtin.beauty import DetailedSurface, detailed_surface
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from .bake import bake_skin
from .plan import CapturePlan
from .scene import capture_scene, set_camera
from .skin import SKIN_TONES, baked_material
from .surface import SkinSurface


def render_capture(folder: Path, plan: CapturePlan, provenance: dict, threads: int | None = None) -> Capture:
    """Render what the plan says into the folder, skipping images that are already whole.

    Raises:
        LiveHandError: the folder holds another capture, or cannot be written.
    """
    model = load_default_hand()
    capture = plan.make(folder, model, provenance)
    _claim_folder(capture)
    missing = [view for view in capture.views if not is_whole(folder / view.file, view)]
    if missing:
        render_views(capture, missing, plan, model, detailed_surface(model), threads)
    return capture


def render_views(
    capture: Capture,
    views: list[CaptureView],
    plan: CapturePlan,
    model: HandModel,
    detail: DetailedSurface,
    threads: int | None,
) -> None:
    """Render the views, pose by pose, so that Cycles builds its acceleration structure once a pose."""
    scene = capture_scene(threads)
    surface = SkinSurface.create(model, detail)
    tone = SKIN_TONES[plan.tone]
    maps = bake_skin(surface.object, capture.folder / "skin", tone)
    surface.object.data.materials.append(baked_material(maps, tone))
    with tqdm(total=len(views), unit="image", desc="capture") as progress:
        for pose_index, of_pose in groupby(views, lambda view: view.pose_index):
            surface.set_pose(capture.poses[pose_index])
            for view in of_pose:
                _render_view(scene, view, plan, capture.folder)
                progress.update()


def _render_view(scene: bpy.types.Scene, view: CaptureView, plan: CapturePlan, folder: Path) -> None:
    set_camera(scene, view.camera)
    scene.cycles.use_denoising = True
    scene.cycles.samples = plan.samples if view.split == "train" else plan.eval_samples
    # One noise pattern for all views would be learnt as texture.
    scene.cycles.seed = 1000 * view.pose_index + view.camera_index
    final = folder / view.file
    partial = final.with_name("partial_" + final.name)
    scene.render.filepath = str(partial)
    bpy.ops.render.render(write_still=True)
    if not is_whole(partial, view):
        raise LiveHandError(f"Cycles must write {partial}, got no whole image; is the disk full?")
    partial.rename(final)


def is_whole(path: Path, view: CaptureView) -> bool:
    """Whether the image exists, decodes and has its camera's size."""
    try:
        with Image.open(path) as image:
            image.load()
            return image.size == tuple(view.camera.size_px)
    except OSError:
        return False


def _claim_folder(capture: Capture) -> None:
    """Write the index, or check that it is this capture's own."""
    index = capture.folder / "transforms.json"
    previous = index.read_text() if index.is_file() else None
    try:
        (capture.folder / "images").mkdir(parents=True, exist_ok=True)
        if previous is None:
            save_capture_index(capture)
    except OSError as error:
        raise LiveHandError(f"the capture folder {capture.folder} must be writable ({error})") from error
    if previous is not None:
        _check_same_capture(capture, previous)


def _check_same_capture(capture: Capture, previous: str) -> None:
    if previous.strip() != index_document(capture).strip():
        raise LiveHandError(
            f"{capture.folder} holds another capture (other seed, sizes or version); give an empty folder"
        )
