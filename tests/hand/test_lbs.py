"""Skinning against a slow reference written from the paper's equations, its symmetries and its gradients."""

import numpy as np
import pytest
import torch
from livehand.backend.hand.lbs import SkinTensors, joint_transforms, pose_correctives, pose_hand
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def skin(hand):
    return SkinTensors.of(hand, dtype=torch.float64)


@pytest.fixture(scope="module")
def small_skin(skin):
    """A dozen vertices, for finite differences; the regressor's rows need not sum to 1 for that."""
    some = list(range(0, len(skin.v_template), 110))
    return skin._replace(
        v_template=skin.v_template[some],
        lbs_weights=skin.lbs_weights[some],
        J_regressor=skin.J_regressor[:, some] + 0.05,
        shapedirs=skin.shapedirs[some],
        posedirs=skin.posedirs[some],
        arm_weights=skin.arm_weights[some],
    )


def random_parameters(seed, batch=()):
    rng = np.random.default_rng(seed)
    theta, beta, transl = (
        rng.normal(size=(*batch, 16, 3)) * 0.6,
        rng.normal(size=(*batch, 10)),
        rng.normal(size=(*batch, 3)),
    )
    return torch.as_tensor(theta), torch.as_tensor(beta), torch.as_tensor(transl)


def reference(hand, theta, beta, transl):
    """Loops over joints and vertices, homogeneous coordinates (Romero et al. 2017, eq. 1-5)."""
    theta, beta, transl = (np.asarray(value) for value in (theta, beta, transl))
    shaped = hand.v_template + sum(beta[k] * hand.shapedirs[:, :, k] for k in range(10))
    joints = np.array([sum(hand.J_regressor[j, v] * shaped[v] for v in range(len(shaped))) for j in range(16)])
    rotations = Rotation.from_rotvec(theta).as_matrix()
    features = np.concatenate([(rotations[j] - np.eye(3)).ravel() for j in range(1, 16)])
    posed = shaped + sum(features[p] * hand.posedirs[:, :, p] for p in range(135))
    world = []
    for j, parent in enumerate(hand.parents):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = joints[j] - (joints[parent] if parent >= 0 else 0)
        world.append(world[parent] @ local if parent >= 0 else local)
    from_rest = []
    for j in range(16):
        to_joint = np.eye(4)
        to_joint[:3, 3] = -joints[j]
        from_rest.append(world[j] @ to_joint)
    vertices = np.zeros_like(posed)
    for v in range(len(posed)):
        blended = sum(hand.lbs_weights[v, j] * from_rest[j] for j in range(16))
        vertices[v] = (blended @ np.append(posed[v], 1))[:3]
    return vertices + transl, np.array([matrix[:3, 3] for matrix in world]) + transl, np.array(from_rest)


@pytest.mark.parametrize("seed", [0, 1])
def test_against_the_slow_reference(hand, skin, seed):
    parameters = random_parameters(seed)
    vertices, joints, transforms = reference(hand, *parameters)
    posed = pose_hand(skin, *parameters)
    np.testing.assert_allclose(posed.vertices, vertices, atol=1e-12)
    np.testing.assert_allclose(posed.joints, joints, atol=1e-12)
    np.testing.assert_allclose(posed.transforms, transforms, atol=1e-12)


def test_rest_is_the_template(hand, skin):
    zero = torch.zeros(3, dtype=torch.float64)
    posed = pose_hand(skin, torch.zeros(16, 3, dtype=torch.float64), torch.zeros(10, dtype=torch.float64), zero)
    np.testing.assert_allclose(posed.vertices, hand.v_template, atol=1e-15)
    np.testing.assert_allclose(posed.joints, hand.joints, atol=1e-15)
    np.testing.assert_allclose(posed.transforms, np.tile(np.eye(4), (16, 1, 1)), atol=1e-15)


def test_shape_alone_adds_its_directions(hand, skin):
    _, beta, _ = random_parameters(3)
    posed = pose_hand(skin, torch.zeros(16, 3, dtype=torch.float64), beta, torch.zeros(3, dtype=torch.float64))
    np.testing.assert_allclose(posed.vertices, hand.v_template + hand.shapedirs @ beta.numpy(), atol=1e-15)


def test_the_root_turns_about_the_wrist_joint(hand, skin):
    theta = torch.zeros(16, 3, dtype=torch.float64)
    theta[0] = torch.tensor([0.3, -1.1, 0.8])
    zero = torch.zeros(10, dtype=torch.float64)
    posed = pose_hand(skin, theta, zero, zero[:3])
    rotation = Rotation.from_rotvec(theta[0].numpy()).as_matrix()
    expected = (hand.v_template - hand.joints[0]) @ rotation.T + hand.joints[0]
    np.testing.assert_allclose(posed.vertices, expected, atol=1e-14)
    np.testing.assert_allclose(posed.joints[0], hand.joints[0], atol=1e-15)


def test_translation_moves_everything_alike(skin):
    theta, beta, transl = random_parameters(4)
    moved, still = pose_hand(skin, theta, beta, transl), pose_hand(skin, theta, beta, torch.zeros_like(transl))
    torch.testing.assert_close(moved.vertices, still.vertices + transl)
    torch.testing.assert_close(moved.joints, still.joints + transl)
    torch.testing.assert_close(moved.transforms, still.transforms)


def test_a_finger_moves_only_what_hangs_on_it(hand, skin):
    theta = torch.zeros(16, 3, dtype=torch.float64)
    theta[5] = torch.tensor([0.0, 0.0, 1.0])
    posed = pose_hand(skin, theta, torch.zeros(10, dtype=torch.float64), torch.zeros(3, dtype=torch.float64))
    moved = np.abs(posed.vertices.numpy() - hand.v_template).max(1) > 1e-12
    hangs = hand.lbs_weights[:, [5, 6]].sum(1) > 0
    bulges = np.abs(hand.posedirs[:, :, 36:45]).max((1, 2)) > 0
    assert moved.any()
    assert not (moved & ~hangs & ~bulges).any()


def test_the_left_hand_is_the_exact_mirror_of_the_right(hand, skin):
    left = SkinTensors.of(hand.for_side("left"), dtype=torch.float64)
    for seed in range(3):
        theta, beta, transl = random_parameters(seed)
        mirror = torch.as_tensor(MIRROR_POINT)
        right_hand = pose_hand(skin, theta, beta, transl)
        left_hand = pose_hand(left, theta * torch.as_tensor(MIRROR_AXIS_ANGLE), beta, transl * mirror)
        torch.testing.assert_close(left_hand.vertices, right_hand.vertices * mirror, atol=1e-14, rtol=0)
        torch.testing.assert_close(left_hand.joints, right_hand.joints * mirror, atol=1e-14, rtol=0)


def test_mirroring_twice_gives_the_hand_back(hand):
    twice = hand.for_side("left").for_side("right")
    for name in ("v_template", "f", "ft", "shapedirs", "posedirs"):
        np.testing.assert_array_equal(getattr(twice, name), getattr(hand, name))


def test_a_batch_is_a_loop(skin):
    parameters = random_parameters(5, (2, 3))
    batch = pose_hand(skin, *parameters)
    assert batch.vertices.shape == (2, 3, len(skin.v_template), 3)
    for i, j in np.ndindex(2, 3):
        single = pose_hand(skin, *(value[i, j] for value in parameters))
        for whole, part in zip(batch, single, strict=True):
            torch.testing.assert_close(whole[i, j], part)


def test_transforms_carry_rest_joints_to_posed_joints(skin):
    theta, beta, transl = random_parameters(6)
    posed = pose_hand(skin, theta, beta, transl)
    rest = skin.J_regressor @ (skin.v_template + skin.shapedirs @ beta)
    carried = (posed.transforms[:, :3, :3] @ rest[..., None])[..., 0] + posed.transforms[:, :3, 3]
    torch.testing.assert_close(carried + transl, posed.joints)
    lengths = [
        torch.linalg.norm(joints[1:] - joints[list(skin.parents[1:])], dim=-1) for joints in (rest, posed.joints)
    ]
    torch.testing.assert_close(*lengths)


@pytest.mark.parametrize("scale", [0.0, 1e-8, 1e-3, 1.0, 3.0])
def test_gradients_are_finite(hand, scale):
    skin = SkinTensors.of(hand)
    theta, beta, transl = (value.float().requires_grad_() for value in random_parameters(7))
    pose_hand(skin, theta * scale, beta, transl).vertices.square().sum().backward()
    for value in (theta, beta, transl):
        assert value.grad is not None
        assert torch.isfinite(value.grad).all()
    assert beta.grad.abs().max() > 0


@pytest.mark.slow
def test_gradients_at_rest_are_right(small_skin):
    """At theta = 0 exactly, where the formulas of rotations divide by zero."""
    theta = torch.zeros(16, 3, dtype=torch.float64, requires_grad=True)
    _, beta, transl = random_parameters(8)
    beta.requires_grad_()

    def posed(theta, beta):
        return pose_hand(small_skin, theta, beta, transl).vertices

    assert torch.autograd.gradcheck(posed, (theta, beta))


@pytest.mark.slow
def test_gradients_of_a_random_pose_are_right(small_skin):
    parameters = [value.requires_grad_() for value in random_parameters(9)]
    assert torch.autograd.gradcheck(lambda *values: pose_hand(small_skin, *values)[:2], parameters)


def test_correctives_vanish_at_rest_and_ignore_the_root(skin):
    rotations = torch.eye(3, dtype=torch.float64).repeat(16, 1, 1)
    assert pose_correctives(skin, rotations).abs().max() == 0
    rotations[0] = torch.as_tensor(Rotation.from_rotvec([0.4, 1, 2]).as_matrix())
    assert pose_correctives(skin, rotations).abs().max() == 0
    rotations[1] = rotations[0]
    assert pose_correctives(skin, rotations).abs().max() > 1e-4


def test_joint_transforms_of_a_two_link_chain_by_hand():
    """Joint 1 at x = 1 turned by 90 degrees about z: the point (2, 0, 0) goes to (1, 1, 0)."""
    rotations = torch.eye(3, dtype=torch.float64).repeat(16, 1, 1)
    rotations[1] = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    joints = torch.zeros(16, 3, dtype=torch.float64)
    joints[1, 0] = 1
    transforms = joint_transforms(rotations, joints, (-1, *([0] * 15)))
    point = torch.tensor([2.0, 0, 0, 1], dtype=torch.float64)
    torch.testing.assert_close(transforms[1] @ point, torch.tensor([1.0, 1, 0, 1], dtype=torch.float64))
    torch.testing.assert_close(transforms[0] @ point, point)


def test_type_follows_the_tensors(hand):
    skin = SkinTensors.of(hand)
    posed = pose_hand(skin, torch.zeros(16, 3), torch.zeros(10), torch.zeros(3))
    assert posed.vertices.dtype == torch.float32


def test_the_forearm_turns_about_the_wrist_and_takes_its_share_of_a_vertex(hand, skin):
    """Romero et al. 2017, eq. 2, with one bone more, whose joint is the wrist's."""
    theta, beta, transl = random_parameters(3)
    forearm = torch.tensor([0.3, -0.2, 0.5], dtype=torch.float64)
    share = torch.linspace(0, 1, len(hand.v_template), dtype=torch.float64) * skin.lbs_weights[:, 0]
    armed = skin._replace(arm_weights=share)
    straight, bent = pose_hand(armed, theta, beta, transl), pose_hand(armed, theta, beta, transl, forearm)
    assert torch.equal(straight.vertices, pose_hand(skin, theta, beta, transl).vertices)
    assert torch.equal(straight.joints, bent.joints)
    root, turn = (Rotation.from_rotvec(value.numpy()) for value in (theta[0], forearm))
    corrected = pose_hand(skin, torch.zeros_like(theta), beta, torch.zeros(3, dtype=torch.float64))
    rest = corrected.vertices + pose_correctives(skin, torch.as_tensor(Rotation.from_rotvec(theta).as_matrix()))
    from_wrist = (rest - corrected.joints[0]).numpy()
    offset = (root * turn).apply(from_wrist) - root.apply(from_wrist)
    expected = straight.vertices.numpy() + share.numpy()[:, None] * offset
    np.testing.assert_allclose(bent.vertices.numpy(), expected, atol=1e-12)
    assert np.abs(bent.vertices.numpy() - straight.vertices.numpy()).max() > 0.01
