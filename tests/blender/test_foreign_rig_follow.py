"""A hand made elsewhere drives ours: live by constraints, and baked into keyframes."""

import bpy
import numpy as np
import pytest
from livehand.backend.foreign_rig.naming import guess_joints
from livehand.backend.foreign_rig.shape_fit import rest_nodes
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.foreign_rig.bake import bake
from livehand.livehand_blender.foreign_rig.follow import follow
from livehand.livehand_blender.foreign_rig.skeleton import read_skeleton
from livehand.livehand_blender.rig.hand import add_hand

MOST_M, MEAN_M = 0.005, 0.003  # between our fingertips and the true ones


def our_tips(hand):
    """[5, 3] m of the evaluated mesh: the vertices farthest along the last bones."""
    model = load_default_hand().for_side(hand.livehand.side)
    rest = rest_nodes(model, np.zeros(10))
    rows = [int(np.linalg.norm(model.v_template - rest[4 * finger + 4], axis=1).argmin()) for finger in range(5)]
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = hand.livehand.mesh.evaluated_get(depsgraph)
    return np.array([mesh.matrix_world @ mesh.data.vertices[row].co for row in rows])


def tip_errors_m(hand, foreign_hand, frames):
    errors = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        errors.append(np.linalg.norm(our_tips(hand) - foreign_hand.fingertips(), axis=1))
    return np.array(errors)


def source_of(foreign, hand, kind, tmp_path):
    write = {"glb": foreign.write_glb, "fbx": foreign.write_fbx}
    return hand.armature if kind == "as made" else foreign.read_file(write[kind](hand, tmp_path / f"h.{kind}"))


@pytest.fixture
def moving(foreign, model):
    """A foreign hand that is animated, and its frames; ours stands elsewhere, turned."""
    made = foreign.make_foreign_hand(model.side)
    frames = made.animate(("rest", "fist", "point", "pinch", "relaxed", "spread"))
    ours = add_hand(bpy.context, model)
    ours.location, ours.rotation_euler = (0.3, -0.7, 0.2), (0.5, 1, 2)
    bpy.context.view_layer.update()
    return made, frames, ours


@pytest.mark.parametrize("kind", ["as made", "glb", "fbx"])
@pytest.mark.parametrize("way", ["live", "baked"])
def test_fingertips_meet_the_true_ones(foreign, model, moving, tmp_path, way, kind):
    made, frames, ours = moving
    source = source_of(foreign, made, kind, tmp_path)
    found = guess_joints(read_skeleton(source), model.side).joint_map()
    assert found == made.joint_map
    if way == "live":
        follow(bpy.context, ours, load_default_hand(), source, found)
    else:
        assert bake(bpy.context, ours, load_default_hand(), source, found, frames) == len(frames)
    errors = tip_errors_m(ours, made, frames)
    print(f"{way} {kind} {model.side}: mean {1e3 * errors.mean():.2f} mm, max {1e3 * errors.max():.2f} mm")
    assert errors.mean() < MEAN_M
    assert errors.max() < MOST_M
