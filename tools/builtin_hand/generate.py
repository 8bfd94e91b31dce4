"""Generates the template, `hand_without_arm.npz`, and the hand that ships, `hand_with_arm.npz`, from the tables.

    anatomy -> rays -> signed distance -> dense mesh -> [quads] -> template -> weights, shapes, joints, correctives,
    atlas

The quads come from Blender's QuadriFlow, which the backend may not call and whose vertex count changes with small edits
of the surface. So the template is kept as data, and the command line below starts from its quads. To remesh it,
`tools/builtin_hand/quad_remesh.py` makes quads from `dense_surface()` and calls the same functions. A forearm's
quads grow on these (`forearm_quads.py`).

    python -m livehand.tools.builtin_hand.generate [--forearm] OUT.npz
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ...backend.hand.atlas import unwrap_millimetres
from ...backend.hand.model import JOINT_NAMES, PARENTS
from ...backend.hand.model_file import ARM_KEY, load_hand_model
from ...backend.teacher.forearm import arm_weights, squeezed_for_atlas
from ...backend.teacher.frames import build_to_template, template_to_build
from ...backend.teacher.meshes import QuadMesh, outward, vertex_normals
from ...backend.teacher.projection import project_to_surface
from ...backend.teacher.rays import build_rays
from . import TEMPLATE
from .extraction import extract_mesh
from .forearm_quads import forearm_quads
from .joint_frames import JointFrames, joint_frames
from .joint_regressor import joint_regressor
from .pose_correctives import pose_correctives
from .shape_directions import shape_directions
from .skinning_weights import dense_weights, transferred_weights

_DENSE_SPACING = 1.6  # mm
_NO_PARENT = 4294967295  # of the root in MANO's files


def build_hand(quads: QuadMesh, forearm: bool = False) -> dict[str, np.ndarray]:
    """Build the arrays of the file of a hand with these quads, with or without a forearm; MANO's names and units."""
    rays = build_rays()
    frames = joint_frames(rays)
    vertices, faces = quads.vertices, split_quads(quads)
    normals = vertex_normals(vertices, faces)
    dense = extract_mesh(rays, _DENSE_SPACING)
    weights = transferred_weights(dense, dense_weights(rays, *dense), vertices, normals)
    directions = shape_directions(vertices, normals, weights, frames)
    vt, ft = unwrap_millimetres(squeezed_for_atlas(vertices) if forearm else vertices, faces)
    return {
        "v_template": build_to_template(vertices),
        "f": faces.astype(np.uint32),
        "weights": weights,
        "shapedirs": directions.vertices * 1e-3,
        "posedirs": pose_correctives(vertices, faces, weights, normals, frames) * 1e-3,
        "J_regressor": joint_regressor(vertices, frames.position, directions),
        "vt": vt.astype(np.float32),
        "ft": ft.astype(np.uint32),
        "quads": quads.quads,
        **_joint_arrays(frames),
        **({ARM_KEY: arm_weights(vertices, weights[:, 0])} if forearm else {}),
    }


def template_quads() -> QuadMesh:
    """Return the quads of the template, which are on the surface already."""
    with np.load(TEMPLATE, allow_pickle=False) as arrays:
        return QuadMesh(template_to_build(load_hand_model(TEMPLATE).v_template), arrays["quads"])


def quads_with_forearm() -> QuadMesh:
    """Return the quads of the template, and a forearm's that grow on them."""
    return forearm_quads(build_rays(), template_quads())


def dense_surface() -> tuple[np.ndarray, np.ndarray]:
    """Extract vertices [N, 3] (build frame, mm) and faces [M, 3] of the smooth stump hand, for a quad remesher."""
    return extract_mesh(build_rays(), _DENSE_SPACING)


def projected_quads(vertices: np.ndarray, quads: np.ndarray) -> QuadMesh:
    """Project quads of a remesher onto the surface."""
    return QuadMesh(project_to_surface(build_rays(), vertices, with_details=False, steps=4), quads)


def split_quads(mesh: QuadMesh) -> np.ndarray:
    """Cut quads along their shorter diagonal: triangles [2 Q, 3], outward, all first halves, then all second ones."""
    v, q = mesh
    first = np.linalg.norm(v[q[:, 0]] - v[q[:, 2]], axis=1) < np.linalg.norm(v[q[:, 1]] - v[q[:, 3]], axis=1)
    halves = [
        np.where(first[:, None], q[:, along_first], q[:, along_second])
        for along_first, along_second in (([0, 1, 2], [1, 2, 3]), ([0, 2, 3], [1, 3, 0]))
    ]
    return outward(v, np.vstack(halves))


def write_hand(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a hand's arrays as `.npz`."""
    np.savez_compressed(path, **arrays)  # pyright: ignore[reportArgumentType]


def _joint_arrays(frames: JointFrames) -> dict[str, np.ndarray]:
    return {
        "J": build_to_template(frames.position),
        "kintree_table": np.array([[_NO_PARENT, *PARENTS[1:]], range(16)], dtype=np.int64),
        "joint_names": np.array(JOINT_NAMES),
        "flex_axis": frames.flexion,
        "bone_dir": frames.bone,
        "dorsal_dir": frames.dorsal,
    }


def main() -> None:
    """Write a hand, made from the template's quads (the command line)."""
    parser = argparse.ArgumentParser(description="Rebuild the built-in hand from its anatomy and its template's quads.")
    parser.add_argument("out", type=Path, help="the .npz to write")
    parser.add_argument("--forearm", action="store_true", help="the hand with a forearm")
    args = parser.parse_args()
    quads = quads_with_forearm() if args.forearm else template_quads()
    write_hand(args.out, build_hand(quads, args.forearm))


if __name__ == "__main__":
    main()
