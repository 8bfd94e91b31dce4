"""Formats that Blender's own exporters write: FBX, glTF and USD, of an armature with a skinned mesh."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

import bpy

from ...backend.motion.writers.registry import WRITERS
from ...backend.motion.writers.take import Take, TakenHand
from ...backend.motion.writers.writer import WriteOptions, Writer
from ...backend.records.errors import LiveHandError
from ...backend.system.files import replacing
from ..scene.file_paths import operator_path
from .importing import temporary_scene
from .skinned_mesh import ExportedMesh, MeshTextures, plain_surface
from .skinned_take import add_take

_SHAPE_MOVES = "the shape changes during the take; bones and mesh have its mean"


def _fbx(path: str) -> None:
    bpy.ops.export_scene.fbx(
        filepath=path,
        use_selection=True,
        object_types={"ARMATURE", "MESH"},
        add_leaf_bones=False,
        bake_anim_use_nla_strips=False,
        bake_anim_use_all_actions=False,
        bake_anim_simplify_factor=0.0,
        path_mode="COPY",
        embed_textures=True,
    )


def _gltf(path: str) -> None:
    bpy.ops.export_scene.gltf(
        filepath=path,
        export_format="GLB" if path.endswith(".glb") else "GLTF_SEPARATE",
        use_selection=True,
        use_active_scene=True,
        export_animation_mode="ACTIVE_ACTIONS",
        export_optimize_animation_size=False,
        export_all_influences=True,
        export_tangents=True,
    )


def _usd(path: str) -> None:
    bpy.ops.wm.usd_export(
        filepath=path, selected_objects_only=True, export_animation=True, export_armatures=True, export_uvmaps=True
    )


def _writer(name: str, title: str, suffixes: tuple[str, ...], export: Callable[[str], None]) -> Writer:
    def write(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
        with temporary_scene(bpy.context):
            add_take(bpy.context, take, lambda hand: _surface_of(hand, options))
            with replacing(path) as temporary:
                run_exporter(title, lambda: export(operator_path(temporary)))
        return (_SHAPE_MOVES,) if any(hand.motion.beta.ndim > 1 for hand in take.hands) else ()

    return Writer(name, title, suffixes, write)


def _surface_of(hand: TakenHand, options: WriteOptions) -> ExportedMesh:
    """Return the mesh that a hand wears: its model's, or the surface of an avatar.

    Raises:
        LiveHandError: the avatar cannot be read, is not relightable, or is of another hand model.
    """
    path = options.avatars.get(hand.side)
    if path is None:
        return plain_surface(hand)
    from ...backend.avatars.file import load_avatar
    from ...backend.capture.picture import linear_to_srgb
    from ...backend.render.textures.textured_hand import textured_hand

    avatar, motion = load_avatar(path), hand.motion
    if hand.model.sha256 != avatar.hand_sha256:
        raise LiveHandError(
            f"the avatar '{avatar.name}' must be worn by its own hand model, got '{hand.model.name}'; choose that"
        )
    made = textured_hand(avatar, hand.own_model, motion.betas.mean(0), options.texture_px)
    albedo, normal, roughness = made.textures
    skin = MeshTextures(linear_to_srgb(albedo), normal, roughness)
    values = made.morphs.values(motion.theta, motion.forearms)
    morphs = made.morphs.displacements
    return ExportedMesh(made.vertices, made.faces, made.corner_uv, made.weights, morphs, values, skin)


def run_exporter(title: str, export: Callable[[], object]) -> None:
    """Run one of Blender's exporters, silently.

    Raises:
        LiveHandError: its add-on is not enabled, or it failed.
    """
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            export()
    except (AttributeError, RuntimeError, TypeError) as error:
        lines = [line for line in str(error).splitlines() if line.strip() and not line.startswith("Location")]
        raise LiveHandError(
            f"Blender must be able to write {title} ({lines[-1].strip() if lines else 'no reason given'}); enable its "
            "add-on in the preferences, or choose another format"
        ) from error


BLENDER_WRITERS = (
    _writer("fbx", "FBX", (".fbx",), _fbx),
    _writer("gltf", "glTF", (".glb",), _gltf),
    _writer("usd", "USD", (".usdc", ".usda", ".usd"), _usd),
)
ALL_WRITERS = (*WRITERS, *BLENDER_WRITERS)
