"""Renders a capture; an interrupted run can be resumed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Protocol

import bpy
from tqdm import tqdm

from ...backend.batch.frame_file import is_finished
from ...backend.capture.capture import (
    Capture,
    CaptureView,
    Split,
    SurfaceReference,
    index_document,
    save_capture_index,
)
from ...backend.capture.person import Person
from ...backend.capture.plan import CapturePlan
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import HandPose
from ...backend.surface.base_surface import surface_of_person, whole_surface
from ...backend.surface.stored_surface import StoredSurface
from ...backend.surface.surface_file import surface_sha256, write_surface
from ...backend.system.files import replacing
from ...backend.teacher.detailed_surface import detailed_surface
from ..scene.file_paths import output_path
from .bake import bake_skin
from .dressed_hand import DressedHand, dressed_surface
from .lit_image import LitImages, is_complete_picture
from .own_surface import OwnSurface
from .scene import capture_scene, set_camera
from .skin import SkinTone, baked_material
from .surface import SkinSurface

SURFACE_FILE = "surface.npz"
"""Of the surface that a capture shows, in its folder."""


@dataclass(frozen=True)
class HandWithMaterials:
    """A custom hand model, and the .blend of its look (None: a plain skin)."""

    model: HandModel
    materials: Path | None


Subject = HandWithMaterials | DressedHand | HandModel
"""Whose hand a capture shows: one of your own, an avatar's person's, or a built-in model's in the plan's skin."""


class Surface(Protocol):
    """A hand in the scene that can be posed."""

    def set_pose(self, pose: HandPose) -> None:
        """Move it to the pose."""
        ...


def render_capture(
    folder: Path,
    plan: CapturePlan,
    provenance: dict,
    threads: int | None = None,
    hand: Subject | None = None,
    split: Split | None = None,
) -> Capture:
    """Render the planned views into the folder, skipping images that are already complete.

    Args:
        folder: of the capture.
        plan: its poses, cameras and splits.
        provenance: written to its index.
        threads: of Cycles; None: all.
        hand: None: the default one, in the skin of the plan's person.
        split: whose views alone the capture has; None: of all.

    Raises:
        LiveHandError: the folder holds another capture, or cannot be written.
    """
    subject = hand or load_default_hand()
    model = _model_of(subject)
    capture, surface = plan.make(folder, model, provenance), _surface_of(subject, plan.person)
    if split is not None:
        capture = replace(capture, views=tuple(capture.of_split(split)))
    if surface is not None:
        capture = replace(capture, surface=SurfaceReference(SURFACE_FILE, surface_sha256(surface)))
    _begin_or_resume(capture, surface)
    missing = [view for view in capture.views if not is_complete(folder / view.file, view)]
    if capture.is_lit:
        images = {_image_key(view) for view in missing}
        missing = [view for view in capture.views if _image_key(view) in images]
    if missing:
        render_views(capture, missing, plan, subject, threads)
    return capture


def _surface_of(subject: Subject, person: Person) -> StoredSurface | None:
    """Return the surface that the capture will show, with all of its arrays; None for materials of its own."""
    if isinstance(subject, DressedHand):
        return subject.textures.surface
    known = None if isinstance(subject, HandWithMaterials) else surface_of_person(person, subject.sha256)
    return None if known is None else whole_surface(known)


def render_views(
    capture: Capture,
    views: list[CaptureView],
    plan: CapturePlan,
    subject: Subject,
    threads: int | None,
) -> None:
    """Render the views, pose by pose, so that Cycles builds its acceleration structure once per pose."""
    scene = capture_scene(threads)
    surface = _posable(subject, plan.person, capture.folder / "skin")
    lit = LitImages(scene, capture, _model_of(subject)) if capture.is_lit else None
    with tqdm(total=len(views), unit="image", desc="capture") as progress:
        for pose_index, of_pose in groupby(views, lambda view: view.pose_index):
            surface.set_pose(capture.poses[pose_index])
            for _, of_image in groupby(of_pose, _image_key):
                groups = list(of_image)
                scene.cycles.samples = plan.samples if groups[0].split == "train" else plan.eval_samples
                # Noise that is equal in all views would be learnt as texture.
                scene.cycles.seed = 1000 * groups[0].pose_index + groups[0].camera_index
                if lit is None:
                    _render_view(scene, groups[0], capture.folder)
                else:
                    lit.render(groups)
                progress.update(len(groups))


def _image_key(view: CaptureView) -> tuple:
    """Return a key that is equal for the light groups of one image."""
    return view.pose_index, view.camera_index, view.split


def _posable(subject: Subject, person: Person, maps_folder: Path) -> Surface:
    if isinstance(subject, HandModel):
        return builtin_surface(subject, person, maps_folder)
    if isinstance(subject, DressedHand):
        return dressed_surface(subject, maps_folder)
    if subject.materials:
        return OwnSurface.of_materials(subject.model, subject.materials)
    return OwnSurface.plain(subject.model, SkinTone.of(person))


def _model_of(subject: Subject) -> HandModel:
    return subject if isinstance(subject, HandModel) else subject.model


def builtin_surface(
    model: HandModel, person: Person, maps_folder: Path, factor: bpy.types.Image | None = None
) -> SkinSurface:
    """Add a person's detailed hand to the scene, with its skin; the folder gets the baked maps, or has them.

    An image over the atlas may multiply the skin's albedo.
    """
    detail, tone = detailed_surface(model).with_tendons(person.tendons), SkinTone.of(person)
    surface = SkinSurface.create(model, detail, person.veins_mm)
    maps = bake_skin(surface.object, maps_folder, tone)
    surface.object.data.materials.append(baked_material(maps, tone, factor))
    return surface


def _render_view(scene: bpy.types.Scene, view: CaptureView, folder: Path) -> None:
    set_camera(scene, view.camera)
    scene.cycles.use_denoising = True
    final = folder / view.file
    with replacing(final) as temporary:
        scene.render.filepath = output_path(temporary)
        bpy.ops.render.render(write_still=True)
        if not is_complete(temporary, view):
            raise LiveHandError(f"Cycles must write {final}, got no complete image; is the disk full?")


def is_complete(path: Path, view: CaptureView) -> bool:
    """Return whether the image exists, can be decoded and has its camera's size."""
    width, height = view.camera.size_px
    size_px = (width, height)
    return is_complete_picture(path, size_px) if view.is_linear else is_finished(path, size_px)


def _begin_or_resume(capture: Capture, surface: StoredSurface | None) -> None:
    """Write surface and index, or check that the existing index is of the same capture."""
    index = capture.folder / "transforms.json"
    previous = index.read_text() if index.is_file() else None
    try:
        (capture.folder / "images").mkdir(parents=True, exist_ok=True)
        if previous is None:
            if surface is not None:
                write_surface(capture.folder / SURFACE_FILE, surface)
            save_capture_index(capture)
    except OSError as error:
        raise LiveHandError(f"the capture folder {capture.folder} must be writable ({error})") from error
    if previous is not None:
        _check_same_capture(capture, previous)


def _check_same_capture(capture: Capture, previous: str) -> None:
    if previous.strip() != index_document(capture).strip():
        raise LiveHandError(
            f"{capture.folder} holds another capture (other seed, sizes, skin or version); choose an empty folder"
        )
