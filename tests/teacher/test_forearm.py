"""The built-in hand with a forearm: its measures, its bend at the wrist, and that the hand itself stays what it is."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import builtin_hand_path, load_hand_model
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.teacher.forearm import ARM_FROM_MM, FOREARM_MM, squeezed_for_atlas
from livehand.backend.teacher.frames import swap_distal, template_to_build
from livehand.backend.teacher.rays import build_rays
from livehand.backend.teacher.sdf import signed_distance
from livehand.tools.builtin_hand.forearm_quads import forearm_quads
from livehand.tools.builtin_hand.generate import build_hand, quads_with_forearm, template_quads
from scipy.spatial.transform import Rotation

BEND_MM = 25.0


@pytest.fixture(scope="module")
def armed():
    return load_hand_model("hand_with_arm")


@pytest.fixture(scope="module")
def beyond_mm(armed):
    """[V] how far each vertex lies beyond the wrist joint."""
    return template_to_build(armed.v_template)[:, 0]


def section_mm(model, beyond):
    """(breadth, depth) of the template across the arm."""
    mesh = trimesh.Trimesh(template_to_build(model.v_template), model.f, process=False)
    return np.ptp(mesh.section([1, 0, 0], [beyond, 0, 0]).vertices, axis=0)[[2, 1]]


def volume_ml(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False).volume * 1e6


@pytest.mark.nightly  # seconds; it changes with its generator alone
def test_generator_gives_the_shipped_hand_with_an_arm():
    built = build_hand(quads_with_forearm(), forearm=True)
    with np.load(builtin_hand_path()) as shipped:
        assert set(built) == set(shipped)
        for name in shipped:
            assert built[name].dtype == shipped[name].dtype, name
            if shipped[name].dtype.kind == "f":
                np.testing.assert_allclose(built[name], shipped[name], rtol=0, atol=1e-9, err_msg=name)
            else:
                np.testing.assert_array_equal(built[name], shipped[name], err_msg=name)


def test_the_hand_itself_stays_what_it_is(hand, armed, beyond_mm):
    """Its vertices, joints, weights and directions are the stump hand's, in the same order."""
    own = template_to_build(hand.v_template)[:, 0] < ARM_FROM_MM
    same = np.flatnonzero(beyond_mm < ARM_FROM_MM)
    np.testing.assert_allclose(armed.v_template[same], hand.v_template[own], rtol=0, atol=1e-15)
    np.testing.assert_allclose(armed.joints, hand.joints, rtol=0, atol=1e-6)
    np.testing.assert_allclose(armed.lbs_weights[same], hand.lbs_weights[own], atol=1e-12)
    np.testing.assert_allclose(armed.shapedirs[same], hand.shapedirs[own], atol=1e-5)


def test_an_arm_has_an_adults_measures(armed, beyond_mm):
    assert beyond_mm.max() == pytest.approx(FOREARM_MM, abs=10)
    at = np.arange(15.0, 150.0, 5.0)
    breadth, depth = np.array([section_mm(armed, beyond) for beyond in at]).T
    narrowest = breadth + depth
    assert at[narrowest.argmin()] < 50
    np.testing.assert_allclose((breadth[3], depth[3]), (58, 40), rtol=0.08)
    np.testing.assert_allclose((breadth.max(), depth.max()), (85, 75), rtol=0.1)
    assert (np.diff(narrowest[at > 50]) > 0).all()


def test_an_arm_is_closed_and_no_tube(armed):
    mesh = trimesh.Trimesh(armed.v_template, armed.f, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    section = mesh.section([1, 0, 0], [0.095 + 0.12, 0, 0]).vertices
    palmar, dorsal = -section[:, 1].min(), section[:, 1].max()
    assert palmar > 1.1 * dorsal  # the flexors
    lowest = section[section[:, 1].argmin()]
    assert abs(lowest[2]) > 1e-3 or abs(section[section[:, 1].argmax(), 2] - lowest[2]) > 2e-3


def test_the_surface_changes_beyond_the_wrist_only():
    rays, rng = build_rays(), np.random.default_rng(0)
    points = rng.uniform((-ARM_FROM_MM, -60, -50), (190, 35, 100), (2000, 3))
    stump, arm = signed_distance(rays, points), signed_distance(rays, points, forearm_mm=FOREARM_MM)
    near = np.abs(stump) < 4
    np.testing.assert_array_equal(arm[near], stump[near])


def test_weights_of_the_arm(armed, beyond_mm):
    wrist = armed.lbs_weights[:, 0]
    assert (armed.arm_weights[beyond_mm <= -BEND_MM] == 0).all()
    np.testing.assert_array_equal(armed.arm_weights[beyond_mm >= BEND_MM], wrist[beyond_mm >= BEND_MM])
    np.testing.assert_allclose(wrist[beyond_mm >= BEND_MM], 1)
    order = np.argsort(beyond_mm)
    share = (armed.arm_weights / np.maximum(wrist, 1e-9))[order][wrist[order] > 0.5]
    assert (np.diff(share) >= -1e-9).all()
    assert np.diff(share).max() < 0.1


@pytest.mark.parametrize(
    "turn_deg", [(0, 0, 60), (0, 0, -60), (0, 25, 0), (0, -25, 0), (40, 0, 0), (-40, 0, 0)], ids=str
)
def test_a_bent_wrist_keeps_its_volume(armed, beyond_mm, turn_deg):
    """Within 10 % of what lies within 25 mm of the joint: about 90 ml."""
    across = np.array([np.pi / 4 * np.prod(section_mm(armed, beyond)) for beyond in (-5.0, 0.0, 10.0, 20.0)]).mean()
    around_ml = across * 2 * BEND_MM * 1e-3
    rest = HandPose.rest()
    bent = posed_vertices(armed, replace(rest, forearm=np.deg2rad(turn_deg)))
    lost = volume_ml(posed_vertices(armed, rest), armed.f) - volume_ml(bent, armed.f)
    assert abs(lost) < 0.1 * around_ml


@pytest.mark.parametrize("side", ["right", "left"])
def test_posed_at_random_as_a_slow_reference(armed, side):
    """The hand as if it had no forearm, and the forearm's share turned about joint 0 before the root turns."""
    rng = np.random.default_rng(3)
    for _ in range(3):
        beta = rng.normal(size=10)
        pose = HandPose(rng.normal(size=(16, 3)) * 0.5, beta, rng.normal(size=3), side, rng.normal(size=3) * 0.5)
        model = armed.for_side(side)
        expected = posed_vertices(armed, replace(pose, forearm=np.zeros(3)))
        shaped = model.v_template + model.shapedirs @ beta
        wrist = model.J_regressor[0] @ shaped
        root, turn = (Rotation.from_rotvec(value).as_matrix() for value in (pose.theta[0], pose.forearm))
        features = Rotation.from_rotvec(pose.theta[1:]).as_matrix() - np.eye(3)
        shaped = shaped + model.posedirs @ features.ravel()
        for vertex in range(len(expected)):
            expected[vertex] += armed.arm_weights[vertex] * (root @ (turn - np.eye(3)) @ (shaped[vertex] - wrist))
        np.testing.assert_allclose(posed_vertices(armed, pose), expected, atol=1e-12)


def test_the_mirrored_pose_is_the_other_hand(armed):
    rng = np.random.default_rng(4)
    pose = HandPose(rng.normal(size=(16, 3)) * 0.4, np.zeros(10), rng.normal(size=3), "right", rng.normal(size=3) * 0.5)
    mirrored = posed_vertices(armed, pose.mirrored())
    np.testing.assert_allclose(mirrored, posed_vertices(armed, pose) * [-1, 1, 1], atol=1e-12)


def test_the_atlas_gives_the_arm_half_the_hands_scale(armed, beyond_mm):
    corners, points = armed.v_template[armed.f], armed.vt[armed.ft]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    sides = points[:, 1:] - points[:, :1]
    in_atlas = np.abs(np.linalg.det(sides))
    on_hand, on_arm = (beyond_mm[armed.f] < 0).all(1), (beyond_mm[armed.f] > 75).all(1)
    scale = [np.sqrt(in_atlas[part].sum() / area[part].sum()) for part in (on_hand, on_arm)]
    assert scale[1] / scale[0] == pytest.approx(0.5, abs=0.05)
    assert in_atlas[on_hand].sum() > 0.65 * in_atlas.sum()


def test_squeezing_for_the_atlas_keeps_the_hand_and_halves_the_end():
    points = np.array([[-80.0, 3, 4], [ARM_FROM_MM, 18, -7], [120, 20, 10], [121, 20, 10]])
    squeezed = squeezed_for_atlas(points)
    np.testing.assert_array_equal(squeezed[:2], points[:2])
    np.testing.assert_allclose(squeezed[2, 1:], [10, 5])
    assert squeezed[3, 0] - squeezed[2, 0] == pytest.approx(0.5, rel=1e-6)


def test_quads_grow_on_even_loops_only():
    quads = template_quads()
    with pytest.raises(LiveHandError, match="remesh"):
        forearm_quads(build_rays(), quads._replace(quads=quads.quads[1:]))


def test_the_arms_vertices_lie_on_its_surface(armed):
    points = swap_distal(template_to_build(armed.v_template))
    distance = np.abs(signed_distance(build_rays(), points, with_details=False, forearm_mm=FOREARM_MM))
    assert (distance > 1e-5).sum() <= 3  # of which two are the stump hand's, between fingers
    assert distance[points[:, 0] < -ARM_FROM_MM].max() < 0.5
