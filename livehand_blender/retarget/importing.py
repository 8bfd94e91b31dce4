"""BVH, FBX and glTF files -> a hand's motion, through Blender's own importers; nothing imported stays."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ...backend.hand.model import HandModel
from ...backend.motion.motion import HandMotion
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import Side
from ...backend.retarget.joint_guess import JointGuess, guess_joints
from ...backend.retarget.rest_alignment import align, source_nodes
from ...backend.retarget.retarget import retarget
from ...backend.retarget.shape_fit import HandShape, fit_shape
from .skeleton import read_skeleton
from .source import sample_source

RIG_SUFFIXES = (".bvh", ".fbx", ".glb", ".gltf")
UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}
_ADD_ONS = {".bvh": "BioVision Motion Capture (BVH) format", ".fbx": "FBX format", ".gltf": "glTF 2.0 format"}


@dataclass(frozen=True)
class RigTake:
    """What one hand of a file does.

    Attributes:
        motion: in Blender's world.
        shape: of the motion; its scale is for the object.
        armature: name of the armature in the file.
        unit: that the file's numbers were taken for.
    """

    motion: HandMotion
    shape: HandShape
    armature: str
    unit: str


def read_rig_take(
    context: bpy.types.Context,
    path: Path,
    model: HandModel,
    side: Side | None,
    shape: HandShape | None = None,
    unit: str | None = None,
) -> RigTake:
    """Import a file into a scene of its own, read a hand's motion off it, and remove everything again.

    Args:
        context: whose scene gives the frame rate where a file has none (glTF).
        path: `.bvh`, `.fbx`, `.glb` or `.gltf`.
        model: our hand, of the side that is wanted where the file has both.
        side: which hand to read; None: the model's, or the only one.
        shape: ours; None: fitted to the file's bones.
        unit: of the file, a key of `UNITS_M`; None: the one that makes the hand as large as a hand.

    Raises:
        LiveHandError: the file cannot be read or holds no hand, or an importer is not enabled.
    """
    if not path.is_file():
        raise LiveHandError(f"a motion must be read from a file, got no file at {path}")
    with _temporary_scene(context) as scene:
        import_rig(path)
        bpy.context.view_layer.update()
        armature, guess = _best_hand(path, scene, side, model.side)
        skeleton, joint_map = read_skeleton(armature), guess.joint_map()
        size = fit_shape(model.for_side(joint_map.side), source_nodes(skeleton, joint_map)).scale
        unit = unit or min(UNITS_M, key=lambda name: abs(np.log(size * UNITS_M[name])))
        scale_m = UNITS_M[unit]
        skeleton = replace(skeleton, heads=skeleton.heads * scale_m, tails=skeleton.tails * scale_m)
        source = sample_source(bpy.context, armature, joint_map, _frames(armature))
        source = replace(source, wrists=source.wrists * scale_m)
        alignment = align(skeleton, joint_map, model, shape)
        return RigTake(retarget(source, alignment), alignment.shape, armature.name, unit)


@contextlib.contextmanager
def _temporary_scene(context: bpy.types.Context) -> Iterator[bpy.types.Scene]:
    """Within, the context's scene is a new one; behind, it and everything that was made meanwhile are gone."""
    before = _everything()
    window, shown, render = context.window, context.scene, context.scene.render
    scene = bpy.data.scenes.new("LiveHand Import")
    scene.render.fps, scene.render.fps_base = render.fps, render.fps_base
    try:
        if window is not None:  # the importers' operators look for the window's active object
            window.scene = scene
        with context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
            yield scene
    finally:
        if window is not None:
            window.scene = shown
        bpy.data.scenes.remove(scene)
        bpy.data.batch_remove(_everything() - before)


def _everything() -> set[bpy.types.ID]:
    kinds = [prop.identifier for prop in bpy.data.bl_rna.properties if prop.type == "COLLECTION"]
    return {thing for kind in kinds for thing in getattr(bpy.data, kind)}


def import_rig(path: Path) -> None:
    """Run Blender's importer for the file's kind.

    Raises:
        LiveHandError: there is none, or it failed.
    """
    suffix = ".gltf" if path.suffix.lower() == ".glb" else path.suffix.lower()
    if suffix == ".bvh" and path.read_bytes()[:64].split()[:1] != [b"HIERARCHY"]:
        raise LiveHandError(f"{path.name} must be a BVH file, which begins with HIERARCHY; choose another")
    run = _importer(suffix)
    if run is None:
        raise LiveHandError(
            f"{path.name} must be read by Blender's add-on '{_ADD_ONS[suffix]}', which is not enabled; enable it "
            "in the preferences"
        )
    try:
        # The importers print. What takes it must stay open: glTF's logger keeps it for the next time.
        with contextlib.redirect_stdout(io.StringIO()):
            run(path)
    except (RuntimeError, TypeError) as error:
        # An add-on's exception comes with its whole traceback; its last line says what it was.
        said = [line for line in str(error).splitlines() if line.strip() and not line.startswith("Location")]
        raise LiveHandError(
            f"{path.name} must be a readable {path.suffix} file, Blender's importer failed ({said[-1].strip()}); write "
            "it again"
        ) from error


def _importer(suffix: str):
    """A function that imports a path, None where the add-on is not enabled."""
    if suffix == ".bvh" and hasattr(bpy.types, "IMPORT_ANIM_OT_bvh"):
        return lambda path: bpy.ops.import_anim.bvh(filepath=str(path), update_scene_fps=True, rotate_mode="QUATERNION")
    if suffix == ".fbx" and hasattr(bpy.types, "IMPORT_SCENE_OT_fbx"):
        return lambda path: bpy.ops.import_scene.fbx(filepath=str(path), use_image_search=False)
    if suffix == ".fbx" and _has_operator("wm", "fbx_import"):
        return lambda path: bpy.ops.wm.fbx_import(filepath=str(path))
    if suffix == ".gltf" and hasattr(bpy.types, "IMPORT_SCENE_OT_gltf"):
        # Bones' shapes are put away by the active object, which is the window's, not the temporary scene's.
        return lambda path: bpy.ops.import_scene.gltf(filepath=str(path), disable_bone_shape=True)
    return None


def _has_operator(module: str, name: str) -> bool:
    try:
        getattr(getattr(bpy.ops, module), name).get_rna_type()
    except (AttributeError, KeyError):
        return False
    return True


def _best_hand(path: Path, scene: bpy.types.Scene, side: Side | None, own: Side) -> tuple[bpy.types.Object, JointGuess]:
    armatures = [thing for thing in scene.objects if thing.type == "ARMATURE"]
    if not armatures:
        raise LiveHandError(f"{path.name} must hold an armature, it has none; write it with its skeleton")
    found = []
    for armature in armatures:
        skeleton = read_skeleton(armature)
        guesses = [guess_joints(skeleton, side)] if side else [guess_joints(skeleton, own), guess_joints(skeleton)]
        found += [(armature, guess) for guess in guesses]
    best = min(found, key=lambda pair: len(pair[1].missing))
    missing = best[1].missing
    if missing:
        raise LiveHandError(
            f"{path.name} must hold a whole {side or own} hand, no bones were found for {', '.join(missing)}; "
            "import it with Blender and choose the bones under Other Rig"
        )
    return best


def _frames(armature: bpy.types.Object) -> range:
    """From the first to the last key of the armature's action and of those above it."""
    ends = []
    thing: bpy.types.Object | None = armature
    while thing is not None:
        if thing.animation_data and thing.animation_data.action:
            ends.append(tuple(thing.animation_data.action.frame_range))
        thing = thing.parent
    if not ends:
        return range(1, 2)
    return range(int(np.floor(min(end[0] for end in ends))), int(np.ceil(max(end[1] for end in ends))) + 1)
