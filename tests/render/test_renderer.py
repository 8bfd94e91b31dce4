"""From shot to frame with untrained avatars: outlines, invariances, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS, AvatarConfig, new_avatar
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.precision import has_fast_bf16
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.hand.topology import topology_of
from livehand.backend.image.crop import MARGIN_PX, crop_of
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import DEPTH_BACKGROUND
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer, RenderStopped

pytestmark = pytest.mark.slow

SIZE = (66, 88)
SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 3, 4), (128, 1, 4)), relief=8),
    SuperResConfig(width=8, depth=4),
    SamplerConfig(6, 0.003),
)


# A fused ray stops when its transmittance is below 1/256; super-resolution may add a little to that.
STOP = 1.5 / 256
# Share of pixels whose ray may see its samples in another order, or miss a face, by rounding alone.
FLIPPED = 5e-4


def an_avatar(hand, config=SMALL, seed=0):
    """Untrained, but with a super-resolution that does more than enlarge."""
    avatar = new_avatar("untrained", hand.name, hand.sha256, config, seed)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in avatar.superres.parameters():
            parameter.add_(0.01 * torch.randn(parameter.shape, generator=generator))
    return avatar


@pytest.fixture(scope="module")
def renderer(hand):
    return Renderer(an_avatar(hand), hand, "cpu")


def a_pose(gesture="relaxed", side="right"):
    root = np.array([0.3, -0.5, 0.2])
    theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand(), root)
    pose = HandPose(theta, np.zeros(10), np.array([0.02, 0.01, 0.03]), "right")
    return pose if side == "right" else mirrored(pose)


def mirrored(pose):
    return HandPose(pose.theta * MIRROR_AXIS_ANGLE, pose.beta, pose.transl * MIRROR_POINT, "left")


def vertices_of(hand, pose):
    skin = SkinTensors.of(hand.for_side(pose.side), dtype=torch.float64)
    return pose_hand(skin, *(torch.as_tensor(v) for v in (pose.theta, pose.beta, pose.transl))).vertices.numpy()


def a_camera(middle, size_px=SIZE, distance=0.6, field_m=0.26):
    focal_px = max(size_px) * distance / field_m
    K = np.array([[focal_px, 0, size_px[0] / 2 + 0.4], [0, focal_px, size_px[1] / 2 - 0.7], [0, 0, 1]])
    origin = middle + distance * np.array([0.1, -0.8, 0.59])
    return Camera(K, look_at(origin, middle, np.array([-1.0, 0, 0])), size_px)


def a_shot(hand, size_px=SIZE, gesture="relaxed", **kwargs):
    pose = a_pose(gesture)
    vertices = vertices_of(hand, pose)
    return Shot(pose, vertices, a_camera(vertices.mean(0), size_px, **kwargs))


def mirrored_shots(hand):
    """A right hand, and a left one whose picture is the right one's mirror image."""
    shot = a_shot(hand)
    mirror = np.diag([*MIRROR_POINT, 1])
    K = shot.camera.K.copy()
    K[0, 2] = SIZE[0] - K[0, 2]
    camera = Camera(K, mirror @ shot.camera.cam2world @ mirror, SIZE)
    return shot, Shot(a_pose(side="left"), shot.vertices * MIRROR_POINT, camera)


@pytest.fixture(scope="module")
def shot(hand):
    return a_shot(hand)


@pytest.fixture(scope="module")
def frame(renderer, shot):
    return renderer.render(shot)


def outline(shot, faces):
    """[H, W] whether the mesh covers the pixel's centre, and its depth."""
    positions_px, depth = shot.camera.project(shot.vertices)
    width, height = shot.camera.size_px
    fragments = rasterise(
        torch.as_tensor(positions_px), torch.as_tensor(depth), torch.as_tensor(faces), (width, height)
    )
    nearest = torch.full((width * height,), torch.inf, dtype=torch.float64)
    nearest = nearest.scatter_reduce(0, fragments.pixel, fragments.depth, "amin").reshape(height, width).numpy()
    return np.isfinite(nearest), nearest


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


@pytest.mark.parametrize("config", [PRESETS["default"], PRESETS["paper"]], ids=["default", "paper"])
def test_an_untrained_avatar_has_the_meshs_outline_and_depth(hand, config):
    shot = a_shot(hand, (132, 176))
    avatar = new_avatar("untrained", hand.name, hand.sha256, config)
    frame = Renderer(avatar, hand, "cpu").render(shot)
    covered, depth = outline(shot, hand.f)
    assert covered.sum() > 2000
    assert iou(frame.alpha > 0.5, covered) > 0.92
    within = covered & (frame.alpha > 0.95)
    assert np.median(np.abs(frame.depth - depth)[within]) < config.sampler.shell_m
    assert (frame.depth[frame.alpha < 0.5] == DEPTH_BACKGROUND).all()


def test_frames_hold_what_they_promise(frame):
    width, height = SIZE
    assert frame.rgb.shape == (height, width, 3)
    assert {frame.rgb.dtype, frame.alpha.dtype, frame.depth.dtype} == {np.dtype(np.float32)}
    assert frame.alpha.min() >= 0
    assert frame.alpha.max() <= 1
    assert frame.rgb.min() >= 0
    assert (frame.rgb <= frame.alpha[..., None] + 1e-6).all()  # premultiplied
    assert frame.rgb[frame.alpha > 0.9].min() > 0.01
    assert frame.rgb[frame.alpha == 0].size == 0 or frame.rgb[frame.alpha == 0].max() == 0


def test_rendering_again_gives_the_same(renderer, shot, frame):
    again = renderer.render(shot)
    np.testing.assert_array_equal(again.rgb, frame.rgb)
    np.testing.assert_array_equal(again.depth, frame.depth)


@pytest.mark.parametrize(("x0", "y0", "size_px"), [(20, 30, (30, 24)), (-6, 40, (40, 60)), (32, 42, (3, 5))])
def test_a_crop_of_the_camera_is_a_crop_of_the_frame(renderer, shot, frame, x0, y0, size_px):
    """Up to the very border: the window reaches past it. By even pixels, so that the low grids coincide.

    The tolerance is for what an untrained super-resolution makes of nothing, at the windows' edges.
    """
    part = renderer.render(replace(shot, camera=shot.camera.cropped(x0, y0, size_px)))
    width, height = size_px
    for name in ("rgb", "alpha", "depth"):
        whole, cut = getattr(frame, name), getattr(part, name)
        left, right, bottom = max(0, x0), min(x0 + width, SIZE[0]), min(y0 + height, SIZE[1])
        np.testing.assert_allclose(
            cut[: bottom - y0, left - x0 : right - x0], whole[y0:bottom, left:right], atol=1e-3, rtol=1e-3
        )
    assert part.alpha.max() > 0.9


def test_moving_the_world_changes_nothing(renderer, shot, frame):
    away = np.array([0.7, -0.4, 0.9])
    cam2world = shot.camera.cam2world.copy()
    cam2world[:3, 3] += away
    camera = replace(shot.camera, cam2world=cam2world)
    moved = renderer.render(replace(shot, vertices=shot.vertices + away, camera=camera))
    difference = np.abs(moved.rgb - frame.rgb).max(-1)
    assert (difference > 2e-3).mean() < 0.005  # where single precision decides an outline pixel otherwise
    assert difference.mean() < 1e-4
    assert frame.rgb.max() > 0.05


def test_a_larger_world_looks_the_same_and_is_farther(renderer, shot, frame):
    cam2world = shot.camera.cam2world.copy()
    cam2world[:3, 3] *= 10
    camera = replace(shot.camera, cam2world=cam2world)
    large = renderer.render(replace(shot, vertices=shot.vertices * 10, camera=camera))
    difference = np.abs(large.rgb - frame.rgb).max(-1)
    assert (difference > 2e-3).mean() < 0.005
    assert difference.mean() < 1e-4
    solid = (frame.alpha > 0.5) & (large.alpha > 0.5)
    ratio = large.depth[solid] / frame.depth[solid]
    assert np.median(ratio) == pytest.approx(10, rel=1e-4)
    assert (np.abs(ratio - 10) < 0.02).mean() > 0.99


def test_the_left_hand_is_the_right_hands_mirror_image(hand):
    """With the paper's field, whose density depends on nothing but (u, v, h) and the pose as the right hand has it."""
    config = replace(SMALL, field=FieldConfig(kind="paper"))
    avatar = new_avatar("untrained", hand.name, hand.sha256, config)
    with torch.no_grad():
        avatar.field.pose.weight *= 30  # so that a wrong pose shows
    renderer = Renderer(avatar, hand, "cpu")
    shot, left = mirrored_shots(hand)
    one, other = renderer.render(shot), renderer.render(left)
    np.testing.assert_allclose(left.vertices, vertices_of(hand, left.pose), atol=1e-12)
    assert (np.abs(np.fliplr(other.alpha) - one.alpha) > 5e-3).mean() < 0.005
    assert iou(np.fliplr(other.alpha) > 0.5, one.alpha > 0.5) > 0.995
    # The mirrored pose must reach the field mirrored back.
    wrong = renderer.render(replace(left, pose=replace(left.pose, theta=left.pose.theta * MIRROR_AXIS_ANGLE)))
    assert (np.abs(wrong.alpha - other.alpha) > 5e-3).mean() > 0.01


def test_an_avatar_of_a_left_hand_takes_left_poses_as_they_are(hand):
    left = hand.for_side("left")
    renderer = Renderer(an_avatar(left), left, "cpu")
    pose = a_pose(side="left")
    vertices = vertices_of(left, pose)
    shot = Shot(pose, vertices, a_camera(vertices.mean(0)))
    np.testing.assert_array_equal(renderer._canonical_theta(shot.pose), pose.theta)
    assert iou(renderer.render(shot).alpha > 0.5, outline(shot, left.f)[0]) > 0.85


def test_a_view_without_the_hand_is_empty(renderer, shot):
    away = shot.camera.cam2world @ np.diag([1.0, -1, -1, 1])  # turned round
    frame = renderer.render(replace(shot, camera=replace(shot.camera, cam2world=away)))
    assert frame.alpha.max() == frame.rgb.max() == 0
    assert (frame.depth == DEPTH_BACKGROUND).all()
    beside = renderer.render(replace(shot, camera=shot.camera.cropped(1000, 0, SIZE)))
    assert beside.alpha.max() == 0


def test_a_deformed_mesh_is_followed(renderer, hand, shot):
    """Sculpted vertices, whatever the pose says."""
    bulged = shot.vertices + np.where(shot.vertices[:, :1] < np.median(shot.vertices[:, 0]), 0.012, 0.0)
    sculpted = replace(shot, vertices=bulged)
    assert iou(outline(sculpted, hand.f)[0], outline(shot, hand.f)[0]) < 0.95
    alpha = renderer.render(sculpted).alpha > 0.5
    assert iou(alpha, outline(sculpted, hand.f)[0]) > iou(alpha, outline(shot, hand.f)[0]) + 0.02


@pytest.mark.parametrize("size_px", [(33, 47), (1, 1), (64, 2), (5, 90)])
def test_odd_sizes(renderer, hand, size_px):
    shot = a_shot(hand, size_px)
    frame = renderer.render(shot)
    assert frame.rgb.shape == (size_px[1], size_px[0], 3)
    assert frame.alpha.max() > 0.3 or size_px == (1, 1)
    if size_px == (33, 47):
        assert iou(frame.alpha > 0.5, outline(shot, hand.f)[0]) > 0.8


def test_half_precision_is_close(hand, shot, frame):
    fast = Renderer(an_avatar(hand), hand, "cpu", "bf16").render(shot)
    assert np.abs(fast.rgb - frame.rgb).mean() < 0.002
    assert np.abs(fast.alpha - frame.alpha).max() < 0.05
    most = np.abs(fast.rgb - frame.rgb).max()
    assert most < 0.05
    assert (most > 0) == has_fast_bf16(torch.device("cpu"))  # elsewhere bf16 is emulated, and fp32 taken


def in_small_chunks(backend):
    """A backend of this kind whose ray renderers take few rays or samples per chunk."""

    class SmallChunks(type(backend)):
        def ray_renderer(self, field, config, precision):
            whole = super().ray_renderer(field, config, precision)
            is_fused = isinstance(self, NumbaBackend)
            return replace(whole, **({"rays_per_chunk": 100} if is_fused else {"samples_per_chunk": 600}))

    return SmallChunks()


def test_chunks_do_not_show(hand, shot, frame, backend):
    """Up to the light that numba's rays leave out by stopping early; `frame` is rendered by numba."""
    chunked = Renderer(an_avatar(hand), hand, "cpu", backend=in_small_chunks(backend)).render(shot)
    np.testing.assert_allclose(chunked.rgb, frame.rgb, atol=1e-5 if isinstance(backend, NumbaBackend) else STOP)


def test_it_stops_between_chunks(hand, shot, backend):
    renderer, calls = Renderer(an_avatar(hand), hand, "cpu", backend=in_small_chunks(backend)), []

    def should_stop():
        calls.append(None)
        return len(calls) == 3

    with pytest.raises(RenderStopped):
        renderer.render(shot, should_stop)
    assert len(calls) == 3


def test_the_networks_stay_as_their_owner_has_them(hand, shot):
    avatar = an_avatar(hand)
    avatar.field.train()
    before = {name: value.clone() for name, value in avatar.field.state_dict().items()}
    Renderer(avatar, hand, "cpu", "bf16").render(shot)
    assert avatar.field.training
    assert all(torch.equal(value, before[name]) for name, value in avatar.field.state_dict().items())


def by_both_backends(hand, shot, avatar=None, precision="fp32"):
    """The frame by numba, and by the reference."""
    return tuple(
        Renderer(avatar or an_avatar(hand), hand, "cpu", precision, one).render(shot)
        for one in (NumbaBackend(), ReferenceBackend())
    )


@pytest.mark.parametrize("gesture", ["relaxed", "fist"])
def test_both_backends_lead_to_the_same_frame(hand, gesture):
    one, other = by_both_backends(hand, a_shot(hand, (132, 176), gesture))
    for name in ("rgb", "alpha"):
        difference = np.abs(getattr(one, name) - getattr(other, name))
        assert (difference > STOP).mean() < FLIPPED, name
        assert difference.mean() < STOP / 100, name
    solid = (one.alpha > 0.5) & (other.alpha > 0.5)
    assert solid.sum() > 3000
    assert (np.abs(one.depth - other.depth)[solid] > 5e-4).mean() < 1e-3


def anisotropic(shot, stretch):
    """The same view in pixels that are `stretch` times as wide as high."""
    width, height = shot.camera.size_px
    camera = Camera(np.diag([1, stretch, 1]) @ shot.camera.K, shot.camera.cam2world, (width, round(height * stretch)))
    return replace(shot, camera=camera)


@pytest.mark.parametrize("stretch", [0.5, 3.0])
def test_anisotropic_pixels_show_the_same_hand_by_both_backends(hand, stretch):
    square, avatar = a_shot(hand), an_avatar(hand)
    with torch.no_grad():
        for plane in avatar.field.planes:
            plane.table.mul_(30)  # so that what fades with a pixel's footprint is seen
    shot = anisotropic(square, stretch)
    one, other = by_both_backends(hand, shot, avatar)
    assert np.abs(one.rgb - other.rgb).mean() < 3e-5  # 9e-5 where one backend takes K's first focal length
    covered, depth = outline(shot, hand.f)
    assert iou(one.alpha > 0.5, covered) > 0.8
    within = covered & (one.alpha > 0.95)
    assert np.median(np.abs(one.depth - depth)[within]) < SMALL.sampler.shell_m


@pytest.mark.parametrize("stretch", [0.25, 1.0, 4.0])
def test_the_window_holds_the_shell_in_anisotropic_pixels(hand, stretch):
    shot = anisotropic(a_shot(hand, (240, 320)), stretch)
    topology = topology_of(hand)
    mesh = posed_mesh(topology, torch.as_tensor(shot.vertices, dtype=torch.float32))
    config = SamplerConfig(4, 0.02)
    window = crop_of(mesh, shot.camera, config)
    pixels, _ = shot.camera.project((mesh.vertices + 0.0195 * mesh.normals).numpy())
    inside = pixels.clip(0, shot.camera.size_px)  # what lies past the image is not rendered
    first = 2 * np.array([window.x0 + MARGIN_PX, window.y0 + MARGIN_PX])
    last = 2 * np.array([window.x0 + window.width - MARGIN_PX, window.y0 + window.height - MARGIN_PX])
    assert (inside >= first).all()
    assert (inside <= last).all()


def test_both_backends_in_half_precision(hand):
    one, other = by_both_backends(hand, a_shot(hand), precision="bf16")
    assert np.abs(one.rgb - other.rgb).mean() < 2e-4  # the kernels compute in 8-bit integers where they can
    assert np.abs(one.alpha - other.alpha).max() < 0.02


def test_planes_on_a_left_hand_are_the_right_ones_mirror_image(hand, backend):
    """With a field that has no normals, light or view as input: it cannot know the side."""
    avatar = new_avatar("untrained", hand.name, hand.sha256, SMALL)
    with torch.no_grad():
        avatar.field.relief.table.zero_()
        first = avatar.field.trunk[0].weight
        first[:, avatar.field.normal_slice.start - 3 :] = 0  # normals, light and view: the world's, not the hand's
    renderer = Renderer(avatar, hand, "cpu", backend=backend)
    shot, left = mirrored_shots(hand)
    one, other = renderer.render(shot), renderer.render(left)
    for name in ("alpha", "rgb"):
        difference = np.abs(np.flip(getattr(other, name), 1) - getattr(one, name))
        assert (difference > 5e-3).mean() < 0.01, name
    assert iou(np.fliplr(other.alpha) > 0.5, one.alpha > 0.5) > 0.99


def test_an_avatar_of_another_hand_is_refused(hand):
    avatar = new_avatar("hers", "her_hand", "0" * 64, SMALL)
    with pytest.raises(LiveHandError, match=r"'hers' must be given its own hand model 'her_hand' \(sha256 0000"):
        Renderer(avatar, hand)


def test_a_mesh_of_another_hand_is_refused(renderer, shot):
    with pytest.raises(LiveHandError, match=r"must have the (1272|1919) vertices .*, got (1271|1918)"):
        renderer.render(replace(shot, vertices=shot.vertices[:-1]))


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_a_missing_gpu_is_told(hand):
    with pytest.raises(LiveHandError, match="needs a CUDA GPU"):
        Renderer(an_avatar(hand), hand, "cuda")
    assert Renderer(an_avatar(hand), hand, "auto").torch_device == torch.device("cpu")
