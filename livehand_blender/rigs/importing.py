"""BVH, FBX and glTF files -> a hand's motion, by Blender's own importers; everything imported is removed again."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ...backend.hand.model import HandModel
from ...backend.motion.motion import HandMotion
from ...backend.records.errors import LiveHandError
from ...backend.records.side import Side
from ...backend.rigs.bvh_positions import with_offsets
from ...backend.rigs.doubts import LARGEST_SIZE, SMALLEST_SIZE
from ...backend.rigs.joint_guess import JointGuess, guess_joints
from ...backend.rigs.rest_alignment import source_nodes
from ...backend.rigs.rig_reading import read_motion
from ...backend.rigs.shape_fit import HandShape, fit_shape
from ...backend.rigs.source_skeleton import JointMap
from ...backend.system.files import MIB, read_regular
from ..scene.removal import remove_scene
from .source import SourceRig, read_skeleton, sample_source

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "dm": 0.1, "ft": 0.3048}
_COMMON_UNITS = ("m", "cm", "mm")  # the others are tried if none of these gives the size of a hand
_MOST_BVH_BYTES = 512 * MIB
_ROUNDING = 1e-3  # of a frame, by which importers of files in seconds miss it
Importer = Callable[[Path], object]
_ADD_ONS = {".bvh": "BioVision Motion Capture (BVH) format", ".fbx": "FBX format", ".gltf": "glTF 2.0 format"}


@dataclass(frozen=True)
class RigFile:
    """An animated rig in a file, and how to read it.

    Attributes:
        path: `.bvh`, `.fbx`, `.glb`, `.gltf` or `.vrm`, which is a glTF.
        side: which of its hands to read; None: our hand's side, or the only one.
        unit: of its lengths, a key of `UNITS_M`; None: the one that gives the hand a hand's usual size.
        fps: of its frames; None: as the file says.
    """

    path: Path
    side: Side | None = None
    unit: str | None = None
    fps: float | None = None


@dataclass(frozen=True)
class RigFileMotion:
    """The motion of one hand of a file.

    Attributes:
        motion: in Blender's world.
        shape: of the motion; its scale is for the object.
        armature: name of the armature in the file.
        joint_map: which of its bones were read.
        doubt: what speaks against the motion; None: nothing.
    """

    motion: HandMotion
    shape: HandShape
    armature: str
    joint_map: JointMap
    doubt: str | None


def read_rig_file(
    context: bpy.types.Context, file: RigFile, model: HandModel, shape: HandShape | None = None
) -> RigFileMotion:
    """Import a file into a temporary scene, and read a hand's motion from it.

    Args:
        context: its scene gives the frame rate if the file has none (glTF).
        file: to be read.
        model: our hand, of the side that is preferred if the file has both.
        shape: ours; None: fitted to the file's bones.

    Raises:
        LiveHandError: the file cannot be read or contains no hand, or an importer is not enabled.
    """
    path = file.path
    if not path.is_file():
        raise LiveHandError(f"a motion must be read from a file, got no file at {path}")
    with temporary_scene(context) as scene:
        import_rig(path)
        bpy.context.view_layer.update()
        armature, guess = _best_hand(path, scene, file.side, model.side)
        skeleton, joint_map = read_skeleton(armature), guess.joint_map()
        size = fit_shape(model.for_side(joint_map.side), source_nodes(skeleton, joint_map)).scale
        scale_m = UNITS_M[file.unit or likely_unit(size)]
        skeleton = replace(skeleton, heads=skeleton.heads * scale_m, tails=skeleton.tails * scale_m)
        source = sample_source(
            bpy.context, SourceRig(armature, joint_map), _frames(armature, _stretch(path, scene))
        ).scaled(scale_m)
        found = read_motion(skeleton, joint_map, source, model, shape)
        return RigFileMotion(found.motion, found.shape, armature.name, joint_map, found.doubt)


def likely_unit(size: float) -> str:
    """Guess the unit in which a rig that is `size` times our hand, read in metres, has a hand's usual size."""
    common = [unit for unit in _COMMON_UNITS if SMALLEST_SIZE <= size * UNITS_M[unit] <= LARGEST_SIZE]
    return min(common or UNITS_M, key=lambda unit: abs(np.log(size * UNITS_M[unit])))


@contextlib.contextmanager
def temporary_scene(context: bpy.types.Context) -> Iterator[bpy.types.Scene]:
    """Give the context a new scene, within; afterwards it and everything created meanwhile are removed."""
    before = all_data()
    window, shown, render = context.window, context.scene, context.scene.render
    scene = bpy.data.scenes.new("LiveHand")
    scene.render.fps, scene.render.fps_base = render.fps, render.fps_base
    try:
        if window is not None:  # the importers use the window's active object
            window.scene = scene
        with context.temp_override(scene=scene, view_layer=scene.view_layers[0]):
            yield scene
    finally:
        if window is not None:
            window.scene = shown
        remove_scene(scene, all_data() - before - {scene})


def _importer(suffix: str) -> Importer | None:
    """Find a function that imports a path; None if the add-on is not enabled."""
    if suffix == ".bvh" and hasattr(bpy.types, "IMPORT_ANIM_OT_bvh"):
        return _import_bvh
    if suffix == ".fbx" and hasattr(bpy.types, "IMPORT_SCENE_OT_fbx"):
        return lambda path: bpy.ops.import_scene.fbx(filepath=str(path), use_image_search=False)
    if suffix == ".fbx" and _has_operator("wm", "fbx_import"):
        return lambda path: bpy.ops.wm.fbx_import(filepath=str(path))
    if suffix == ".gltf" and hasattr(bpy.types, "IMPORT_SCENE_OT_gltf"):
        # The importer hides bone shapes relative to the active object, which is not in the temporary scene.
        return lambda path: bpy.ops.import_scene.gltf(filepath=str(path), disable_bone_shape=True)
    return None


def _import_bvh(path: Path) -> None:
    text = with_offsets(read_regular(path, _MOST_BVH_BYTES).decode("utf-8", "replace"))
    with contextlib.ExitStack() as stack:
        if text is not None:
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            path = Path(folder) / path.name
            path.write_text(text, encoding="utf-8")
        bpy.ops.import_anim.bvh(filepath=str(path), update_scene_fps=True, rotate_mode="QUATERNION")


def _has_operator(module: str, name: str) -> bool:
    try:
        getattr(getattr(bpy.ops, module), name).get_rna_type()
    except (AttributeError, KeyError):
        return False
    return True


def import_rig(path: Path, importer_of: Callable[[str], Importer | None] = _importer) -> None:
    """Run Blender's importer for the file's kind, or the one that `importer_of` returns for its suffix.

    Raises:
        LiveHandError: it is not enabled, or it failed.
    """
    suffix = ".gltf" if path.suffix.lower() in (".glb", ".vrm") else path.suffix.lower()
    if suffix == ".bvh" and path.read_bytes()[:64].split()[:1] != [b"HIERARCHY"]:
        raise LiveHandError(f"{path.name} must be a BVH file, which starts with HIERARCHY; choose another")
    run = importer_of(suffix)
    if run is None:
        raise LiveHandError(
            f"{path.name} must be read by Blender's add-on '{_ADD_ONS[suffix]}', which is not enabled; enable it "
            "in the preferences"
        )
    try:
        # The importers print. The stream must stay open, because glTF's logger keeps it.
        with contextlib.redirect_stdout(io.StringIO()):
            run(path)
    except (RuntimeError, TypeError) as error:
        # An add-on's exception includes its traceback; the last line is the message.
        lines = [line for line in str(error).splitlines() if line.strip() and not line.startswith("Location")]
        raise LiveHandError(
            f"{path.name} must be a readable {path.suffix} file, Blender's importer failed ({lines[-1].strip()}); "
            "export it again"
        ) from error


def _best_hand(path: Path, scene: bpy.types.Scene, side: Side | None, own: Side) -> tuple[bpy.types.Object, JointGuess]:
    armatures = [thing for thing in scene.objects if thing.type == "ARMATURE"]
    if not armatures:
        raise LiveHandError(f"{path.name} must hold an armature, it has none; export it with its skeleton")
    found = []
    for armature in armatures:
        skeleton = read_skeleton(armature)
        guesses = (
            [guess_joints(skeleton, side, is_determined=True)]
            if side
            else [guess_joints(skeleton, own), guess_joints(skeleton)]
        )
        found += [(armature, guess) for guess in guesses]
    best = min(found, key=lambda pair: len(pair[1].missing))
    if not best[1].is_hand:
        raise LiveHandError(
            f"{path.name} must hold a {side or own} hand, there is none in this file: no bones are named like fingers, "
            "and none has five chains of bones below it; give a file with fingers, or import it with Blender and "
            "choose the bones under Retarget"
        )
    return best


def _stretch(path: Path, scene: bpy.types.Scene) -> float:
    """Return the scene's frames in a frame of the file.

    Blender's add-on for FBX sets the file's rate, but places keys by the rate rounded to a whole number.
    """
    is_add_ons = path.suffix.lower() == ".fbx" and hasattr(bpy.types, "IMPORT_SCENE_OT_fbx")
    return scene.render.fps_base if is_add_ons else 1.0


def _frames(armature: bpy.types.Object, stretch: float) -> list[float]:
    """List the frames from the first to the last key of the actions of the armature and its parents."""
    ends = []
    thing: bpy.types.Object | None = armature
    while thing is not None:
        if thing.animation_data and thing.animation_data.action:
            ends.append(tuple(thing.animation_data.action.frame_range))
        thing = thing.parent
    if not ends:
        return [1.0]
    first, last = (find(end[k] for end in ends) / stretch for k, find in enumerate((min, max)))
    frames = range(int(np.floor(first + _ROUNDING)), int(np.ceil(last - _ROUNDING)) + 1)
    return [stretch * frame for frame in frames]


def all_data() -> set[bpy.types.ID]:
    """Collect each data-block of the file once; from Blender 5.2 on, `bpy.data` lists them by kind and all together."""
    kinds = [prop.identifier for prop in bpy.data.bl_rna.properties if prop.type == "COLLECTION"]
    return {thing for kind in kinds for thing in getattr(bpy.data, kind)}
