"""The fine surface that ships: that of the generator, to the steps of its file; and what a pose raises on it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.hand.gestures import FingerAxes
from livehand.backend.hand.lbs import skin_motion
from livehand.backend.hand.model_file import load_hand_model
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.detail_mesh import DetailTemplate, detail_mesh
from livehand.backend.surface.detail_surface import (
    HEIGHT_STEP_MM,
    LEVELS,
    VEIN_STEP,
    detail_surface_of,
    load_detail_surface,
    surface_arrays,
)
from livehand.backend.teacher.detailed_surface import detailed_surface
from livehand.backend.teacher.loop import subdivide
from livehand.tools.builtin_hand import TEMPLATE
from livehand.tools.builtin_hand.fine_offsets import fine_surface
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shipped(hand):
    return load_detail_surface(hand.sha256)


def test_a_hand_of_others_has_none(hand):
    assert load_detail_surface("0" * 64) is None
    assert load_detail_surface(load_hand_model(TEMPLATE).sha256) is None


@pytest.mark.nightly  # seconds; it changes with its generator alone
def test_the_file_that_ships_is_the_generator_s(hand, shipped):
    """Made of two levels where the file is made of three: vertices relax along the surface, but lie on it."""
    made = fine_surface(hand, detailed_surface(hand, levels=LEVELS))
    assert made.offset_m.shape == shipped.offset_m.shape
    matrix = subdivide(hand.f, hand.vt[hand.ft], len(hand.v_template), LEVELS).matrix
    there, here = (matrix @ hand.v_template + each.offset_m for each in (shipped, made))
    apart_mm = 1e3 * np.linalg.norm(there - here, axis=1)
    assert np.median(apart_mm) < 0.3
    assert len(made.raised.forms) == len(shipped.raised.forms)
    for ours, theirs in zip(made.raised.forms, shipped.raised.forms, strict=True):
        assert (ours.joint, ours.start_deg, ours.full_deg) == (theirs.joint, theirs.start_deg, theirs.full_deg)
        assert np.corrcoef(ours.height_mm, theirs.height_mm)[0, 1] > 0.9


def test_the_file_s_steps_are_small(hand, shipped):
    again = surface_arrays(shipped)
    np.testing.assert_allclose(again["form/height"][0] * HEIGHT_STEP_MM, shipped.raised.forms[0].height_mm, atol=1e-6)
    np.testing.assert_allclose(again["vein"] * VEIN_STEP, shipped.raised.vein, atol=1e-6)
    assert np.abs(again["offset"]).max() < np.iinfo(np.int16).max


def test_heights_beyond_the_steps_are_an_error(shipped):
    form = shipped.raised.forms[0]
    with pytest.raises(ValueError, match="more steps"):
        surface_arrays(
            type(shipped)(
                shipped.offset_m,
                type(shipped.raised)(
                    (type(form)(form.joint, 0.0, 1.0, form.height_mm + 4.0),),
                    shipped.raised.vein,
                    shipped.raised.flexion,
                    shipped.raised.padding_mm,
                ),
            )
        )


def test_a_fist_raises_knuckles_and_rest_nothing(shipped):
    rest = np.zeros((16, 3))
    np.testing.assert_array_equal(shipped.raised.height_mm(rest, 0.0), 0)
    bent = rest.copy()
    bent[4] = np.deg2rad(90) * shipped.raised.flexion[4]  # the middle finger's knuckle
    assert 3 < shipped.raised.height_mm(bent, 0.0).max() < 4.5


def test_tendons_of_lifted_fingers_stand_out_as_far_as_a_persons_and_knuckles_as_before(shipped):
    weak, lifted, bent = shipped.with_tendons(0.4).raised, np.zeros((16, 3)), np.zeros((16, 3))
    lifted[4] = np.deg2rad(-20) * shipped.raised.flexion[4]
    bent[4] = np.deg2rad(90) * shipped.raised.flexion[4]
    high = shipped.raised.height_mm(lifted, 0.0)
    assert high.max() > 1
    np.testing.assert_allclose(weak.height_mm(lifted, 0.0), 0.4 * high, atol=1e-5)
    np.testing.assert_array_equal(weak.height_mm(bent, 0.0), shipped.raised.height_mm(bent, 0.0))
    assert shipped.with_tendons(1.0).raised is shipped.raised


def test_padding_rises_in_every_pose(shipped):
    own = surface_arrays(shipped) | {"padding": np.full(len(shipped.offset_m), 20, np.int8)}
    padded, bent = detail_surface_of(own).raised, np.zeros((16, 3))
    bent[4] = np.deg2rad(90) * shipped.raised.flexion[4]
    for theta in (np.zeros((16, 3)), bent):
        raised = padded.height_mm(theta, 0.0) - shipped.raised.height_mm(theta, 0.0)
        np.testing.assert_allclose(raised, 20 * HEIGHT_STEP_MM, atol=1e-5)


def test_veins_are_as_high_as_asked_and_higher_in_a_clenched_hand(shipped):
    rest, clenched = np.zeros((16, 3)), np.zeros((16, 3))
    clenched[[1, 4, 7, 10]] = np.deg2rad(80) * shipped.raised.flexion[[1, 4, 7, 10]]
    on_vein = shipped.raised.vein > 0.9
    assert on_vein.any()
    flat = shipped.raised.height_mm(rest, 0.4)[on_vein]
    np.testing.assert_allclose(flat, 0.4 * 0.75 * shipped.raised.vein[on_vein])
    raised = shipped.raised.height_mm(clenched, 0.4) - shipped.raised.height_mm(clenched, 0.0)
    np.testing.assert_allclose(raised[on_vein], 0.4 * 1.25 * shipped.raised.vein[on_vein], atol=1e-6)


THUMB_IP, THUMB_MCP = 15, 14
AROUND_M = 0.010  # along a digit, to both sides of a joint


@pytest.fixture(scope="module")
def bent(hand, shipped):
    """The surface (vertices, faces) with one joint of the right hand flexed and this share of its forms, m."""
    template = DetailTemplate.of(shipped, hand)

    def of(joint, flexion_deg, share=1.0):
        theta = np.zeros((16, 3))
        theta[joint] = np.deg2rad(flexion_deg) * shipped.raised.flexion[joint]
        pose = replace(HandPose.rest(), theta=theta)
        height = torch.as_tensor(share * 1e-3 * shipped.raised.height_mm(theta, 0.0), dtype=torch.float32)
        flat = torch.zeros(len(hand.v_template))
        mesh = detail_mesh(template, skin_motion(template.skin, pose), height, flat, torch.ones(()))
        return mesh.vertices.numpy().astype(float), mesh.faces.numpy()

    return of


def volume_ml(vertices, faces):
    return 1e6 * trimesh.Trimesh(vertices, faces, process=False).volume


def around_ml(hand, vertices, joint):
    """Of a digit at rest: its section at a joint, an ellipse, over twice `AROUND_M`."""
    at, along = hand.joints[joint], hand.joints[joint] - hand.joints[joint - 1]
    along = along / np.linalg.norm(along)
    offset = vertices - at
    near = (np.abs(offset @ along) < 0.002) & (np.linalg.norm(offset, axis=1) < 0.011)
    across = offset[near] - np.outer(offset[near] @ along, along)
    _, _, axes = np.linalg.svd(across - across.mean(0), full_matrices=False)
    sizes = [np.ptp(across @ axis) for axis in axes[:2]]
    return 1e6 * np.pi / 4 * sizes[0] * sizes[1] * 2 * AROUND_M


@pytest.mark.parametrize("joint", [2, 3, 5, 6, 8, 9, 11, 12, THUMB_IP])
@pytest.mark.parametrize("flexion_deg", [45, 70, 90])
def test_a_bent_finger_joint_keeps_its_volume(hand, bent, joint, flexion_deg):
    rest, flexed = bent(joint, 0), bent(joint, flexion_deg)
    around = around_ml(hand, rest[0], joint)
    assert 1.5 < around < 8
    assert volume_ml(*flexed) - volume_ml(*rest) == pytest.approx(0, abs=0.025 * around)


@pytest.mark.parametrize("joint", [1, 4, 7, 10])
def test_a_bent_knuckle_keeps_a_part_of_what_skinning_draws_in(bent, joint):
    rest, skinned, raised = (volume_ml(*bent(joint, *how)) for how in ((0,), (90, 0.0), (90,)))
    assert 3.5 < rest - skinned < 6
    assert raised - skinned > 0.19 * (rest - skinned)


@pytest.mark.parametrize("joint", [1, 4, 7, 10, THUMB_MCP])
def test_a_bent_knuckle_does_not_sink_below_its_bone(hand, bent, joint):
    """Skin over the head of a bone is as far from the joint as at rest, or stands out as its knob."""
    axis, (rest, _), (flexed, _) = hand_axis(joint), bent(joint, 0), bent(joint, 80)
    over = back_of(rest - hand.joints[joint], axis, hand.joints[joint + 1] - hand.joints[joint])
    at_rest, now = (np.linalg.norm(vertices[over] - hand.joints[joint], axis=1).mean() for vertices in (rest, flexed))
    assert 0.95 < now / at_rest < 1.1


def hand_axis(joint):
    return FingerAxes.of_default_hand().flexion[joint]


def back_of(offset, axis, along):
    """[N] which vertices lie on the back above a joint, in a fan of 60 degrees about the bone's normal."""
    along = along - axis * (along @ axis)
    along = along / np.linalg.norm(along)
    dorsal = np.cross(axis, along)
    dorsal = dorsal * np.sign(-((Rotation.from_rotvec(axis * 0.1).apply(along) - along) @ dorsal))
    up, forth, aside = offset @ dorsal, offset @ along, offset @ axis
    return (up > 0.004) & (np.abs(np.arctan2(forth, up)) < np.deg2rad(30)) & (np.abs(aside) < 0.003) & (up < 0.02)
