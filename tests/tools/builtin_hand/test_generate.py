"""The generator rebuilds the hand we ship, array by array."""

import numpy as np
import pytest
import trimesh
from livehand.backend.records.errors import LiveHandError
from livehand.backend.teacher.frames import swap_distal, template_to_build
from livehand.backend.teacher.meshes import outward, vertex_normals
from livehand.backend.teacher.rays import build_rays
from livehand.tools.builtin_hand import TEMPLATE
from livehand.tools.builtin_hand.bone_cores import bone_cores
from livehand.tools.builtin_hand.generate import QuadMesh, build_hand, dense_surface, split_quads, template_quads
from livehand.tools.builtin_hand.skinning_weights import dense_weights
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def built():
    return build_hand(template_quads())


@pytest.fixture(scope="module")
def shipped():
    with np.load(TEMPLATE) as archive:
        return dict(archive)


def test_generator_gives_the_shipped_hand(built, shipped):
    assert set(built) == set(shipped)
    for name, array in shipped.items():
        assert built[name].dtype == array.dtype, name
        if array.dtype.kind == "f":
            np.testing.assert_allclose(built[name], array, rtol=0, atol=1e-9, err_msg=name)
        else:
            np.testing.assert_array_equal(built[name], array, err_msg=name)


def test_joint_regressor_meets_the_joints_under_any_shape(built):
    joints, regressor = built["J"], built["J_regressor"]
    assert regressor.min() >= 0
    np.testing.assert_allclose(regressor @ built["v_template"], joints, atol=1e-5)
    np.testing.assert_allclose(regressor.sum(1), 1)


def test_weights_are_local(built):
    weights = built["weights"]
    np.testing.assert_allclose(weights.sum(1), 1)
    assert weights.min() >= 0
    assert (weights > 0).sum(1).max() <= 5
    middle_tip = weights[weights[:, 6] > 0.5]
    others = [j for j in range(16) if j not in (4, 5, 6)]
    assert middle_tip[:, others].max() == 0


def test_dense_mesh_is_closed_and_its_weights_sum_to_one():
    vertices, faces = dense_surface()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert 300 < mesh.volume / 1000 < 400
    weights = dense_weights(build_rays(), vertices, faces)
    np.testing.assert_allclose(weights.sum(1), 1)
    labels = bone_cores(build_rays(), swap_distal(vertices), vertex_normals(vertices, faces))
    cores = labels >= 0
    assert set(np.unique(labels[cores])) == set(range(16))
    assert np.median(weights[cores, labels[cores]]) > 0.99


def test_a_bent_joint_bulges_by_one_minus_cosine(built):
    """posedirs . (R - I) of a turn by t about the flexion axis is (1 - cos t) times the field at 90 degrees."""
    posedirs, axis = built["posedirs"], built["flex_axis"]
    for joint in (1, 5, 15):
        block = posedirs[:, :, 9 * (joint - 1) : 9 * joint]
        at = {
            t: block @ (Rotation.from_rotvec(t * axis[joint]).as_matrix() - np.eye(3)).ravel() for t in (0.6, np.pi / 2)
        }
        np.testing.assert_allclose(at[0.6], (1 - np.cos(0.6)) * at[np.pi / 2], atol=1e-12)
        reach = np.linalg.norm(at[np.pi / 2], axis=1).max()
        assert 1e-3 < reach <= 3e-3 + 1e-12
    assert np.abs(posedirs[:, :, 9 * 12 : 9 * 13]).max() == 0


def test_flexion_turns_fingertips_to_the_palm(built):
    """A positive turn about the flexion axis moves the tip towards -Y, the palmar side."""
    bone, axis = built["bone_dir"][1:13], built["flex_axis"][1:13]
    assert (np.cross(axis, bone)[:, 1] < -0.5).all()
    np.testing.assert_allclose((axis * bone).sum(1), 0, atol=1e-12)
    np.testing.assert_allclose((built["dorsal_dir"][1:] * built["bone_dir"][1:]).sum(1), 0, atol=1e-12)


def test_size_scales_everything_alike(built):
    about_wrist = built["v_template"] - built["J"][0]
    np.testing.assert_allclose(built["shapedirs"][:, :, 0], 0.045 * about_wrist, atol=1e-12)


def test_quads_are_cut_along_the_shorter_diagonal():
    square = np.array([[0, 0, 0], [1, 0, 0], [2, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [2, 1, 1], [0, 1, 1]], float)
    quads = np.array([[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    faces = split_quads(QuadMesh(square, quads))
    edges = {tuple(sorted(edge)) for face in faces for edge in zip(face, np.roll(face, 1), strict=True)}
    assert (1, 3) in edges
    assert (0, 2) not in edges
    assert trimesh.Trimesh(square, faces, process=False).volume == pytest.approx(1.5)
    np.testing.assert_array_equal(split_quads(QuadMesh(square, quads[:, ::-1])).shape, faces.shape)


def test_an_open_mesh_has_no_outside(hand):
    model = hand
    with pytest.raises(LiveHandError, match="closed"):
        outward(template_to_build(model.v_template), model.f[1:])
