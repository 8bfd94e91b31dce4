"""The look of a hand model, as a .blend: its mesh in the model's vertex order, with the source's materials.

The mesh is in the source's place, so that materials with object or world coordinates are unchanged; captures move it by
a shape key.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import bmesh
import bpy

from ...backend.records.errors import LiveHandError
from ...backend.rigs.hand_from_mesh.hand_model import MeshHand
from ...backend.system.files import replacing
from ..capture.hand_materials import MODEL_KEY
from ..scene.removal import remove_scene
from .pictures import images_of, is_missing, plain_colours
from .rest_mesh import RestMesh

_SUBDIVISION = (
    "levels", "render_levels", "subdivision_type", "use_limit_surface", "quality", "uv_smooth", "boundary_smooth",
)  # fmt: skip


def save_materials(path: Path, source: bpy.types.Object, rest: RestMesh, hand: MeshHand, sha256: str) -> list[str]:
    """Write the .blend with packed images; the open file is unchanged.

    Images whose file is missing are replaced by their materials' colours. Returns the files that are missing.

    Args:
        path: of the .blend.
        source: the object whose materials and subdivision the hand gets.
        rest: its mesh at rest.
        hand: the hand model made of it.
        sha256: of the hand model's file.

    Raises:
        LiveHandError: it cannot be written.
    """
    mesh = _materials_object(source, rest, hand)
    mesh[MODEL_KEY] = sha256
    scene = bpy.data.scenes.new("Hand")  # so that the hand is visible when the file is opened
    scene.collection.objects.link(mesh)
    scene.view_layers[0].update()  # Blender 5.2 crashes when it writes a scene that was never seen
    images = images_of(mesh.data.materials)
    missing = {image for image in images if is_missing(image)}
    try:
        with replacing(path) as temporary, plain_colours(mesh.data.materials, missing), _packed(images - missing):
            bpy.data.libraries.write(str(temporary), {scene}, path_remap="ABSOLUTE", compress=True)
        return sorted(image.filepath for image in missing)
    except RuntimeError as error:
        raise LiveHandError(f"{path} must be writable ({error})") from error
    finally:
        remove_scene(scene, (mesh, mesh.data))


def _materials_object(source: bpy.types.Object, rest: RestMesh, hand: MeshHand) -> bpy.types.Object:
    data = bpy.data.meshes.new("Hand")
    for slot in source.material_slots:
        data.materials.append(slot.material)
    cut = bmesh.new()
    try:
        cut.from_mesh(rest.data)
        _remove_the_rest(cut, hand)
        _add_cap(cut, hand)
        cut.to_mesh(data)
    finally:
        cut.free()
    data.use_auto_texspace = False
    data.texspace_location, data.texspace_size = rest.data.texspace_location, rest.data.texspace_size
    mesh = bpy.data.objects.new("Hand", data)
    mesh.matrix_world = source.matrix_world
    _subdivide_like(mesh, source)
    return mesh


def _remove_the_rest(cut: bmesh.types.BMesh, hand: MeshHand) -> None:
    """Keep only the hand's polygons and vertices, in the model's order."""
    number = cut.verts.layers.int.new("livehand_vertex")
    cut.verts.ensure_lookup_table()
    cut.faces.ensure_lookup_table()
    for vertex, of_hand in zip(cut.verts, hand.cut.vertex_of.tolist(), strict=True):
        vertex[number] = of_hand
    first = {k: cut.verts[index] for k, index in enumerate(hand.cut.source.tolist())}
    kept = set(hand.cut.polygons.tolist())
    others = [face for face in cut.faces if face.index not in kept]
    twins = {
        vertex: first[vertex[number]] for vertex in cut.verts if vertex[number] >= 0 and vertex != first[vertex[number]]
    }
    bmesh.ops.delete(cut, geom=others, context="FACES_ONLY")
    bmesh.ops.weld_verts(cut, targetmap=twins)
    bmesh.ops.delete(cut, geom=[vertex for vertex in cut.verts if not vertex.link_faces], context="VERTS")
    cut.verts.sort(key=lambda vertex: vertex[number])
    assert [vertex[number] for vertex in cut.verts] == list(range(len(hand.cut.source)))
    cut.verts.layers.int.remove(number)
    for layer in cut.verts.layers.deform.values():
        cut.verts.layers.deform.remove(layer)


def _add_cap(cut: bmesh.types.BMesh, hand: MeshHand) -> None:
    """Add the cap's faces with the material of the adjacent skin; its edge is creased to survive subdivision."""
    cut.verts.ensure_lookup_table()
    crease = cut.edges.layers.float.get("crease_edge") or cut.edges.layers.float.new("crease_edge")
    for edge in cut.edges:
        if edge.is_boundary:
            edge[crease] = 1.0
    for corners in hand.cap.tolist():
        beside = {vertex: cut.verts[vertex].link_loops[0] for vertex in corners}
        try:
            face = cut.faces.new([cut.verts[vertex] for vertex in corners])
        except ValueError:  # the face exists already
            continue
        face.material_index = beside[corners[0]].face.material_index
        for loop, vertex in zip(face.loops, corners, strict=True):
            loop.copy_from(beside[vertex])


def _subdivide_like(mesh: bpy.types.Object, source: bpy.types.Object) -> None:
    found = next((m for m in source.modifiers if m.type == "SUBSURF" and m.show_render), None)
    if found is None:
        return
    modifier = mesh.modifiers.new("Subdivision", "SUBSURF")
    for name in _SUBDIVISION:
        setattr(modifier, name, getattr(found, name))


@contextlib.contextmanager
def _packed(images: set[bpy.types.Image]) -> Iterator[None]:
    """Pack the images, within; those with unsaved painting stay packed."""
    packed = [image for image in images if not image.packed_files and image.source in {"FILE", "GENERATED", "TILED"}]
    for image in packed:
        try:
            image.pack()
        except RuntimeError as error:
            raise LiveHandError(
                f"the file {image.filepath} of the image '{image.name}' must exist ({error})"
            ) from error
    clean = [image for image in packed if image.source != "GENERATED" and not image.is_dirty]
    try:
        yield
    finally:
        for image in clean:
            image.unpack(method="REMOVE")
