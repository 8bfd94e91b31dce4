"""Rebuilds the built-in hand with new quads, using Blender's QuadriFlow between two steps of the backend's generator.

This is needed only after a change of the anatomy, because the built hand ships as data. Small edits of the surface
change the number of quads, and then avatars trained on the hand no longer fit.

    python -m livehand.tools.builtin_hand.quad_remesh OUT.npz
"""

from __future__ import annotations

import argparse
from pathlib import Path

import bpy
import numpy as np

from ...backend.records.errors import LiveHandError

_TARGET_FACES = 1500
_SEED = 3


def quad_remesh(
    vertices: np.ndarray, faces: np.ndarray, target_faces: int = _TARGET_FACES
) -> tuple[np.ndarray, np.ndarray]:
    """Remesh a closed surface: vertices [N, 3] and triangles [M, 3] -> vertices [V, 3] and quads [Q, 4], same winding.

    Raises:
        LiveHandError: QuadriFlow failed, or left a face that is not a quad.
    """
    mesh = bpy.data.meshes.new("quad_remesh")
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    hand = bpy.data.objects.new("quad_remesh", mesh)
    bpy.context.scene.collection.objects.link(hand)
    try:
        _run_quadriflow(hand, target_faces)
        return _quads_of(hand.data)
    finally:
        bpy.data.meshes.remove(hand.data)  # also removes the object


def _run_quadriflow(hand: bpy.types.Object, target_faces: int) -> None:
    bpy.context.view_layer.update()
    with bpy.context.temp_override(object=hand, active_object=hand, selected_objects=[hand]):
        result = bpy.ops.object.quadriflow_remesh(
            mode="FACES",
            target_faces=target_faces,
            use_mesh_symmetry=False,
            use_preserve_sharp=False,
            use_preserve_boundary=False,
            smooth_normals=True,
            seed=_SEED,
        )
    if "FINISHED" not in result:
        raise LiveHandError(f"QuadriFlow must finish, got {result}; change the surface a little or the number of faces")


def _quads_of(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    corners = {len(polygon.vertices) for polygon in mesh.polygons}
    if corners != {4}:
        raise LiveHandError(f"QuadriFlow must make quads only, got faces of {sorted(corners)} corners; change the seed")
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", vertices)
    return vertices.reshape(-1, 3).astype(np.float64), np.array([list(polygon.vertices) for polygon in mesh.polygons])


def main() -> None:
    """Build the hand from its anatomy with new quads."""
    from .generate import build_hand, dense_surface, projected_quads, write_hand

    parser = argparse.ArgumentParser(description="Rebuild the built-in hand from its anatomy with new quads.")
    parser.add_argument("out", type=Path, help="the .npz to write")
    out = parser.parse_args().out
    write_hand(out, build_hand(projected_quads(*quad_remesh(*dense_surface()))))


if __name__ == "__main__":
    main()
