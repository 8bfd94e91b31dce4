"""Files that hold no poses although they come with some, or that a program makes some of: which one is meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

_BY_SUFFIX = {
    **dict.fromkeys((".mvn", ".mvnx"), "Xsens MVN: export BVH or FBX with fingers from it, and give that"),
    **dict.fromkeys(
        (".c3d", ".trc", ".tak"), "markers without a skeleton: solve them, export BVH or FBX, and give that"
    ),
    ".casc": "a scene of Cascadeur: export FBX from it, and give that",
    **dict.fromkeys((".uasset", ".umap"), "of Unreal: export the take (LiveLink's too) as FBX, and give that"),
    ".anim": "of Unity: export FBX or glTF from it, and give that",
    **dict.fromkeys((".yml", ".yaml"), "settings; DexYCB's poses are in labels_*.npz (pose_m) beside the pictures"),
    ".vrs": "a headset's recording; HOT3D's poses are in mano_hand_pose_trajectory.jsonl",
    **dict.fromkeys((".pt", ".pth", ".ckpt"), "torch's: save its arrays with numpy.savez, and give that"),
    **dict.fromkeys((".h5", ".hdf5", ".mat", ".parquet"), "save its arrays with numpy.savez, and give that"),
    **dict.fromkeys((".zip", ".tar", ".gz", ".7z"), "an archive: unpack it, and give a file of it"),
    **dict.fromkeys((".mp4", ".mov", ".mkv", ".avi", ".webm"), "a film: livehand track makes a take of it"),
    **dict.fromkeys((".obj", ".ply", ".stl", ".usd", ".usda", ".usdc", ".abc"), "meshes without a skeleton"),
}
_ANGLES = ("flexion", "stretch", "spread", "abduction")
_INTERHAND = (
    "one of InterHand2.6M's annotations without poses; they are in InterHand2.6M_*_MANO_NeuralAnnot.json beside it"
)


def advice_by_suffix(path: Path) -> str | None:
    """Say what a file of another suffix is, and which one is meant; None: unknown."""
    return _BY_SUFFIX.get(path.suffix.lower())


def advice(content: Any) -> str | None:
    """Say what a document without poses is, and which file is meant; None: unknown."""
    return next((words for is_it, words in _BY_CONTENT if is_it(content)), None)


def _has(*names: str) -> Callable[[Any], bool]:
    return lambda content: isinstance(content, Mapping) and set(names) <= content.keys()


def _first_has(*names: str) -> Callable[[Any], bool]:
    """Look into the first values of dictionaries, and of lists, as deep as data sets nest them."""

    def is_it(content: Any) -> bool:
        for _ in range(4):
            if _has(*names)(content):
                return True
            if isinstance(content, Mapping):
                content = next(iter(content.values()), None)
            elif isinstance(content, list):
                content = content[0] if content else None
        return False

    return is_it


def _is_table_of_angles(content: Any) -> bool:
    names = [str(key).lower() for key in content] if isinstance(content, Mapping) else []
    is_angles = any(word in name for name in names for word in _ANGLES)
    return (
        is_angles
        and any(finger in name for name in names for finger in ("index", "digit2"))
        and not any("position" in name for name in names)
    )


_BY_CONTENT: tuple[tuple[Callable[[Any], bool], str], ...] = (
    (_first_has("world_coord", "joint_valid"), _INTERHAND),
    (_first_has("campos", "camrot"), _INTERHAND),
    (_has("images", "annotations"), _INTERHAND),
    (
        _first_has("joint_angles", "wrist_xform"),
        "UmeTrack's joint angles, which are of another hand; HOT3D's poses are "
        "in mano_hand_pose_trajectory.jsonl beside it",
    ),
    (_is_table_of_angles, "a glove's joint angles (Manus, Rokoko); export the take as FBX or BVH, and give that"),
    (_first_has("joint_angles"), "joint angles of a hand whose bones it does not say; give joints' places or a rig"),
    (_has("seg", "joint_2d"), "DexYCB's labels without pose_m; give the labels_*.npz of the data set itself"),
    (_has("obj_arti"), "ARCTIC's object; its hands are in *.mano.npy and *.smplx.npy beside it"),
    (_has("R_k_cam_np"), "ARCTIC's camera; its hands are in *.mano.npy and *.smplx.npy beside it"),
    (_has("objRot", "objTrans"), "HO-3D's object; its hands are in meta/*.pkl with handPose"),
)
