"""Geometry editing as in the paper: the mesh is rendered as edited in Blender, by any tool that moves vertices.

Silhouettes of frames by the shipped avatar against Cycles' own of the same edited mesh. The avatar's skin is a little
softer than the mesh, edited or not: so an edited hand is to agree as well as the unedited one does, or nearly.
"""

import runpy
import sys
from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest
from livehand.livehand_blender.rig.hand import find_hands, mesh_of

EXAMPLES = Path(__file__).parents[2] / "examples"
SIZE_PX = (167, 256)
WORSE = 0.02  # largest loss of IoU by an edit; claws, whose ends are thinner than a pixel, lose 0.015
STALE = 0.05  # upper bound of the IoU of the unedited hand's frame


@pytest.fixture(scope="module")
def edits():
    """The functions of the example that edit a mesh, by name."""
    sys.path.insert(0, str(EXAMPLES))
    try:
        return runpy.run_path(str(EXAMPLES / "make_edited.py"))
    finally:
        sys.path.remove(str(EXAMPLES))


@pytest.fixture
def stage(hand_scene, tmp_path):
    """The hand's mesh in a scene, and a function that gives its coverage by LiveHand and by Cycles."""
    scene = hand_scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    (armature,) = find_hands(scene)

    def coverage(engine):
        scene.render.engine = engine
        scene.render.film_transparent = True
        scene.cycles.samples = 16
        scene.render.filepath = str(tmp_path / f"{engine}.png")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.array(image.pixels[:]).reshape(*SIZE_PX[::-1], 4)
        bpy.data.images.remove(image)
        return pixels[..., 3]

    return mesh_of(armature), coverage


def iou(one, other):
    return np.minimum(one, other).sum() / np.maximum(one, other).sum()


def pull_with_the_cursor(mesh):
    """Edit mode on the basis: the end of the middle finger is stretched to twice its length."""
    bpy.context.view_layer.objects.active = mesh
    mesh.active_shape_key_index = 0
    bpy.ops.object.mode_set(mode="OBJECT")
    positions = np.array([vertex.co[:] for vertex in mesh.data.vertices])
    tip = positions[:, 0].argmin()
    near = np.linalg.norm(positions - positions[tip], axis=1) < 0.02
    mesh.data.vertices.foreach_set("select", near)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.tool_settings.mesh_select_mode = (True, False, False)
    edited = bmesh.from_edit_mesh(mesh.data)
    bmesh.ops.translate(edited, vec=(-0.03, 0, 0.02), verts=[vertex for vertex in edited.verts if vertex.select])
    bmesh.update_edit_mesh(mesh.data)
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize(
    "name",
    [
        "twist",
        "edit mode",
        pytest.param("draw_claws", marks=pytest.mark.nightly),
        pytest.param("swell_fingers", marks=pytest.mark.nightly),
    ],
)
def test_an_edited_hand_is_rendered_as_edited(stage, edits, name):
    mesh, coverage = stage
    before, plain = coverage("LIVEHAND"), coverage("CYCLES")
    (pull_with_the_cursor if name == "edit mode" else edits[name])(mesh)
    ours, truth = coverage("LIVEHAND"), coverage("CYCLES")
    assert iou(ours, truth) > iou(before, plain) - WORSE
    assert iou(before, truth) < iou(ours, truth) - STALE
