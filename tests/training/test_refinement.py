"""Refinement of poses, shape and surface, on a capture rendered by an avatar, so that the true poses are known."""

import json
from dataclasses import replace
from math import degrees, sqrt

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.avatars.file import load_avatar
from livehand.backend.capture.capture import Capture, CaptureView, load_capture, save_capture_index
from livehand.backend.capture.check import check_capture
from livehand.backend.capture.half_size import half_size
from livehand.backend.evaluation.evaluate import encoded_on_black
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_hand_model
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.research.comparison.misfit import pose_error, with_noise
from livehand.backend.research.pose_fit import PoseFitConfig, fit_poses
from livehand.backend.training.config import LossConfig
from livehand.backend.training.losses import crop_loss
from livehand.backend.training.refined_capture import save_refined_capture
from livehand.backend.training.refinement import Refinement, RefinementConfig
from livehand.backend.training.setup import load_what_fits
from livehand.backend.training.step import render_view
from livehand.backend.training.views import TrainingViews
from PIL import Image

CPU = torch.device("cpu")
SIZE = (48, 64)
DIRECTIONS = ([0, 1, 0.2], [0.9, 0.4, -0.6], [-0.3, -0.8, 0.5])
ALL = RefinementConfig(surface_deviation_m=0.001, start_share=0.0, retrace_every=4)


@pytest.fixture(scope="module")
def avatar(hand):
    """With the shipped one's shape and planes, but with a light of its own."""
    baked = new_avatar("baked", hand.name, hand.sha256, PRESETS["default"], seed=0)
    load_what_fits(baked.field, load_avatar().field)
    return baked


@pytest.fixture(scope="module")
def capture(hand, avatar, tmp_path_factory):
    """Three poses from three cameras, rendered by the avatar; the last pose is held out."""
    folder = tmp_path_factory.mktemp("rendered")
    thetas = [
        theta_of(GESTURES[name].angles_deg(), FingerAxes.of_default_hand()) for name in ("relaxed", "open", "point")
    ]
    poses = tuple(HandPose(theta, np.zeros(10), -hand.joints[4]) for theta in thetas)
    views = tuple(
        CaptureView(f"{p}_{c}.png", _camera(np.array(direction)), c, p, "train" if p < 2 else "novel_pose")
        for p in range(len(poses))
        for c, direction in enumerate(DIRECTIONS)
    )
    capture = Capture(folder, hand.sha256, {"made_by": "test"}, poses, views)
    save_capture_index(capture)
    renderer = Renderer(avatar, hand, "cpu")
    for view in views:
        pose = poses[view.pose_index]
        rendered = encoded_on_black(renderer.render(Shot(pose, posed_vertices(hand, pose), view.camera)))
        straight = np.concatenate([rendered[..., :3] / np.maximum(rendered[..., 3:], 1e-6), rendered[..., 3:]], -1)
        Image.fromarray((straight.clip(0, 1) * 255).round().astype(np.uint8)).save(folder / view.file)
    return capture


def _camera(direction, distance=0.6):
    focal_px = SIZE[1] * distance / 0.25
    K = np.array([[focal_px, 0, SIZE[0] / 2], [0, focal_px, SIZE[1] / 2], [0, 0, 1]])
    origin = distance * direction / np.linalg.norm(direction)
    return Camera(K, look_at(origin, np.zeros(3), np.array([-1.0, 0, 0])), SIZE)


def views_of(capture, hand, avatar):
    return TrainingViews(capture, capture.of_split("train"), hand, avatar.config.sampler, CPU, 0)


def perturbed(refinement, size=0.2, seed=0):
    """The refinement with noise added to every parameter."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in refinement.parameters():
            parameter += size * torch.randn(parameter.shape, generator=generator)
    return refinement


def test_fitting_recovers_perturbed_poses(capture, hand, avatar):
    """Errors of one degree and two millimetres; the avatar is the true one and does not change."""
    noisy = with_noise(capture, 1.0, 2.0, seed=0)
    before = {key: value.clone() for key, value in avatar.field.state_dict().items()}
    config = PoseFitConfig(visits=16)
    config = replace(config, refinement=replace(config.refinement, learning_rate=4e-2))
    fitted = fit_poses(avatar, noisy, "train", hand, config, CPU)
    before_fit, after_fit = (pose_error(poses, capture.poses, (0, 1), hand) for poses in (noisy.poses, fitted.poses))
    assert before_fit.vertex_mm > 0.8
    assert after_fit.vertex_mm < 0.3 * before_fit.vertex_mm
    assert fitted.poses[2] is not capture.poses[2]
    np.testing.assert_allclose(fitted.poses[2].theta, capture.poses[2].theta, atol=1e-6)
    assert all(torch.equal(value, before[key]) for key, value in avatar.field.state_dict().items())
    assert all(parameter.requires_grad for parameter in avatar.field.parameters())


def test_corrections_of_zero_change_nothing(capture, hand, avatar):
    views = views_of(capture, hand, avatar)
    refinement = Refinement(capture, hand, ALL, CPU)
    view = views.get(1, 0)
    assert refinement.refined(view, 0) is view  # before it starts
    refinement.begin_step(views, 0, 0.0)
    refined = refinement.refined(view, 0)
    torch.testing.assert_close(refined.mesh.vertices, view.mesh.vertices, atol=1e-7, rtol=0)
    torch.testing.assert_close(refined.conditions.vertex_channels, view.conditions.vertex_channels, atol=2e-5, rtol=0)
    with torch.no_grad():
        image, expected = (render_view(avatar, views, each)[1] for each in (refined, view))
    assert (image - expected).abs().max() < 0.02
    assert (image - expected).abs().mean() < 2e-4


def test_the_derivatives_of_the_image_are_finite_differences(capture, hand, avatar):
    """Derivatives of the loss along random changes of each parameter, by steps smaller than the planes' texels."""
    views = views_of(capture, hand, avatar)
    refinement = Refinement(capture, hand, ALL, CPU)
    refinement.begin_step(views, 0, 0.0)
    view = views.get(0, 0)
    target = view.target.roll(2, 2)

    def loss():
        low, image = render_view(avatar, views, refinement.refined(view, 0))
        return crop_loss(low, image, target, view.is_inside, LossConfig(colour_l1=0.0), None).total

    generator = torch.Generator().manual_seed(4)
    for name, parameter in refinement.named_parameters():
        along = torch.zeros_like(parameter)
        along[:] = torch.randn(parameter.shape, generator=generator)
        (gradient,) = torch.autograd.grad(loss(), parameter)
        values, size = [], 0.0003
        for step in (-size, size):
            with torch.no_grad():
                parameter += step * along
                values.append(float(loss()))
                parameter -= step * along
        difference = (values[1] - values[0]) / (2 * size)
        assert float((gradient * along).sum()) == pytest.approx(difference, rel=0.05), name
        if name in ("theta", "transl"):
            assert gradient[0].abs().min() >= 0
            assert gradient[1:].abs().max() == 0  # other poses


def test_parameters_correct_a_pose_as_documented(capture, hand):
    refinement = perturbed(Refinement(capture, hand, replace(ALL, surface_deviation_m=0.0), CPU))
    config, given = refinement.config, capture.poses[1]
    corrected, vertices = refinement.pose(1)
    numbers = {name: value.detach().double().numpy() for name, value in refinement.named_parameters()}
    pose = HandPose(
        given.theta + config.theta_deviation_rad * numbers["theta"][1],
        given.beta + config.beta_deviation * numbers["beta"],
        given.transl + config.transl_deviation_m * numbers["transl"][1],
    )
    np.testing.assert_allclose(vertices.detach().numpy(), posed_vertices(hand, pose), atol=2e-6)
    for name, value in corrected._asdict().items():
        np.testing.assert_allclose(value.detach().numpy(), getattr(pose, name), atol=1e-6)
        np.testing.assert_allclose(getattr(refinement.poses()[1], name), getattr(pose, name), atol=1e-6)


def test_all_poses_get_the_mean_shape(capture, hand):
    betas = [np.full(10, value) for value in (0.2, 0.6, 5.0)]
    poses = tuple(replace(pose, beta=beta) for pose, beta in zip(capture.poses, betas, strict=True))
    refined = Refinement(replace(capture, poses=poses), hand, ALL, CPU).poses()
    for pose in refined:  # the mean of the training poses'
        np.testing.assert_allclose(pose.beta, 0.4, atol=1e-6)


def test_the_mean_correction_is_removed(capture, hand, avatar):
    views = views_of(capture, hand, avatar)
    refinement = perturbed(Refinement(capture, hand, ALL, CPU))
    before = refinement.theta.detach().clone()
    refinement.begin_step(views, 1, 0.0)
    for values in (refinement.theta, refinement.transl):
        assert values[:2].mean(0).abs().max() < 1e-6
    apart = refinement.theta[0] - refinement.theta[1]
    torch.testing.assert_close(apart, before[0] - before[1])
    assert torch.equal(refinement.theta[2], before[2])  # a held-out pose
    free = perturbed(Refinement(capture, hand, replace(ALL, is_centred=False), CPU))
    before = free.theta.detach().clone()
    free.begin_step(views, 1, 0.0)
    assert torch.equal(free.theta, before)


def test_views_follow_poses_that_have_moved_far(capture, hand, avatar):
    views = views_of(capture, hand, avatar)
    refinement = Refinement(capture, hand, replace(ALL, is_centred=False), CPU)
    refinement.begin_step(views, 0, 0.0)
    before = [views.get(index, 0) for index in (0, 3)]
    with torch.no_grad():
        refinement.transl[0, 0] += 0.3 * ALL.retrace_m / ALL.transl_deviation_m
        refinement.transl[1, 0] += 3 * ALL.retrace_m / ALL.transl_deviation_m
    refinement.begin_step(views, 3, 0.5)  # not yet
    assert all(torch.equal(views.get(i, 0).rays.t, old.rays.t) for i, old in zip((0, 3), before, strict=True))
    refinement.begin_step(views, 4, 0.5)
    near, far = views.get(0, 0), views.get(3, 0)
    assert torch.equal(near.rays.t, before[0].rays.t)
    shift = far.mesh.vertices - before[1].mesh.vertices
    torch.testing.assert_close(shift[:, 0], torch.full((len(shift),), 3 * ALL.retrace_m), atol=1e-6, rtol=0)
    assert torch.equal(far.target, before[1].target)
    refined = refinement.refined(far, 1)  # the pose with which it was traced, so the samples are the traced ones
    assert (refined.rays.samples.height_m - far.rays.samples.height_m).abs().max() < 5e-6


def test_a_resumed_refinement_has_the_same_rays(capture, hand, avatar):
    views = views_of(capture, hand, avatar)
    refinement = perturbed(Refinement(capture, hand, ALL, CPU))
    refinement.begin_step(views, 0, 0.0)
    perturbed(refinement, 0.01, seed=1)  # a change since the views were traced, too small to trace them again
    resumed_views, resumed = views_of(capture, hand, avatar), Refinement(capture, hand, ALL, CPU)
    resumed.load_state_dict(refinement.state_dict())
    refinement.begin_step(views, 5, 0.5)
    resumed.begin_step(resumed_views, 5, 0.5)
    for index in (0, 4):
        one, other = views.get(index, 1), resumed_views.get(index, 1)
        assert torch.equal(one.rays.t, other.rays.t)
        assert torch.equal(one.rays.samples.face, other.rays.samples.face)
    pose = capture.views[4].pose_index
    refined = refinement.refined(views.get(4, 1), pose), resumed.refined(resumed_views.get(4, 1), pose)
    assert torch.equal(refined[0].rays.samples.height_m, refined[1].rays.samples.height_m)


def test_the_penalty_is_the_mean_squared_correction(capture, hand):
    refinement = perturbed(Refinement(capture, hand, replace(ALL, pull=0.1, smoothness=0.0), CPU))
    numbers = [
        value.detach().double() for value in (refinement.theta, refinement.beta, refinement.transl, refinement.surface)
    ]
    expected = 0.1 * sum(float((value**2).mean()) for value in numbers)
    assert float(refinement.penalty().detach()) == pytest.approx(expected, rel=1e-5)
    smooth = Refinement(capture, hand, replace(ALL, pull=0.1, smoothness=3.0), CPU)
    assert float(smooth.penalty().detach()) == 0
    with torch.no_grad():
        smooth.surface.fill_(2.0)  # a constant offset is smooth
        assert float(smooth.penalty()) == pytest.approx(0.1 * 4)
        smooth.surface[5] = 3.0
        edges = torch.as_tensor(hand.f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))
        at_five = int((edges == 5).any(1).sum())
        size = (4 * (len(smooth.surface) - 1) + 9) / len(smooth.surface)
        assert float(smooth.penalty()) == pytest.approx(0.1 * (size + 3 * at_five / len(edges)), rel=1e-5)


def test_a_refined_capture_is_a_capture(capture, hand, tmp_path):
    refinement = perturbed(Refinement(capture, hand, replace(ALL, surface_deviation_m=0.0), CPU))
    folder = tmp_path / "deep" / "refined"
    assert save_refined_capture(capture, refinement, hand, folder) is hand
    back = load_capture(folder)
    assert back.hand_sha256 == hand.sha256
    for ours, expected in zip(back.poses, refinement.poses(), strict=True):
        np.testing.assert_allclose(ours.theta, expected.theta)
    view = back.of_split("novel_pose")[1]
    np.testing.assert_array_equal(back.read_image(view), capture.read_image(capture.of_split("novel_pose")[1]))
    assert not json.loads((folder / "transforms.json").read_text())["frames"][0]["file_path"].startswith("/")


def test_a_refined_capture_has_its_masks(capture, hand, tmp_path):
    masked = replace(capture, folder=tmp_path / "masked", views=(replace(capture.views[0], mask="masks/0.png"),))
    (masked.folder / "masks").mkdir(parents=True)
    pixels = capture.read_pixels(capture.views[0])
    Image.fromarray(pixels).save(masked.folder / capture.views[0].file)
    Image.fromarray(255 - pixels[..., 3]).save(masked.folder / "masks" / "0.png")
    save_refined_capture(
        masked, Refinement(masked, hand, replace(ALL, surface_deviation_m=0.0), CPU), hand, tmp_path / "r"
    )
    back = load_capture(tmp_path / "r")
    np.testing.assert_array_equal(back.read_image(back.views[0]), masked.read_image(masked.views[0]))


def test_the_refinement_of_a_halved_capture_fits_the_images_own_size(capture, hand, tmp_path):
    halved = half_size(capture)
    refinement = Refinement(halved, hand, replace(ALL, surface_deviation_m=0.0), CPU)
    save_refined_capture(halved, refinement, hand, tmp_path / "r")
    back = load_capture(tmp_path / "r")
    check_capture(back, hand)
    assert [view.camera.size_px for view in back.views] == [view.camera.size_px for view in capture.views]
    np.testing.assert_array_equal(back.read_image(back.views[0]), capture.read_image(capture.views[0]))


def test_a_refined_surface_is_a_hand_model_of_its_own(capture, hand, tmp_path):
    refinement = perturbed(Refinement(capture, hand, ALL, CPU))
    refined = save_refined_capture(capture, refinement, hand, tmp_path)
    assert load_capture(tmp_path).hand_sha256 == refined.sha256 != hand.sha256
    offset = refined.v_template - hand.v_template
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 1e-3 * np.abs(refinement.surface.detach()), atol=1e-6)
    for name in ("f", "lbs_weights", "J_regressor", "parents", "shapedirs", "posedirs", "vt", "ft"):
        np.testing.assert_array_equal(getattr(refined, name), getattr(hand, name))
    _, vertices = refinement.pose(0)
    np.testing.assert_allclose(posed_vertices(refined, refinement.poses()[0]), vertices.detach(), atol=2e-6)


def test_noise_has_the_requested_size_and_is_measured(capture, hand):
    many = replace(
        capture,
        poses=capture.poses[:1] * 200,
        views=tuple(replace(capture.views[0], pose_index=index) for index in range(199)),
    )
    noisy = with_noise(many, 1.0, 2.0, seed=3)
    theta = np.stack([pose.theta for pose in noisy.poses[:199]]) - capture.poses[0].theta
    transl = np.stack([pose.transl for pose in noisy.poses[:199]]) - capture.poses[0].transl
    assert degrees(sqrt((theta**2).sum(-1).mean())) == pytest.approx(1.0, rel=0.05)
    assert 1000 * sqrt((transl**2).sum(-1).mean()) == pytest.approx(2.0, rel=0.1)
    assert noisy.poses[199] is many.poses[199]  # held out
    measured = pose_error(noisy.poses, many.poses, range(40), hand)
    assert measured.theta_deg == pytest.approx(1.0, rel=0.1)
    assert measured.transl_mm == pytest.approx(2.0, rel=0.2)
    shifted = tuple(replace(pose, transl=pose.transl + 0.01) for pose in many.poses)
    assert pose_error(shifted, many.poses, range(5), hand).vertex_mm < 1e-6  # an error shared by all poses


def test_forearms_are_posed_and_kept(capture):
    armed = load_hand_model("hand_with_arm")
    turn = np.array([0.1, 0.2, -0.7])
    bent = replace(
        capture, hand_sha256=armed.sha256, poses=tuple(replace(pose, forearm=turn) for pose in capture.poses)
    )
    views = TrainingViews(bent, bent.of_split("train"), armed, PRESETS["default"].sampler, CPU, 0)
    refinement = Refinement(bent, armed, ALL, CPU)
    expected = posed_vertices(armed, bent.poses[0])
    np.testing.assert_allclose(views.get(0, 0).mesh.vertices, expected, atol=1e-6)
    np.testing.assert_allclose(refinement.pose(0)[1].detach(), expected, atol=1e-6)
    np.testing.assert_allclose(refinement.poses()[1].forearm, turn, atol=1e-7)
