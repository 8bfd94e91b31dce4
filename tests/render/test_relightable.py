"""Relightable avatars from shot to frame: light adds up, moves, is kept, and comes from the same side on both hands."""

from copy import copy
from dataclasses import replace
from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.capture.person import Person
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.hand.posed_bones import bone_frames
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import DEPTH_BACKGROUND
from livehand.backend.records.light import Lamp, Light, Sky, sky_directions
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.primary_hits import HitSurface
from livehand.backend.render.renderer import Renderer
from livehand.backend.render.surface_maps import surface_maps
from livehand.backend.surface.base_surface import surface_of_person
from livehand.backend.surface.blood import BLOOD_LOG_ALBEDO, place_log_albedo
from livehand.backend.surface.detail_maps_file import load_surface_detail

pytestmark = pytest.mark.slow

SIZE = (66, 88)
SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 3, 4), (128, 1, 4)), relief=8, light="linear"),
    SuperResConfig(kind="lit", width=8, depth=2),
    SamplerConfig(6, 0.003),
)


def shining(x, y, z):
    """The rotation of a lamp that shines in this direction."""
    back = -np.array([x, y, z], float) / np.linalg.norm([x, y, z])
    right = np.cross([0.1, 0.2, 1.0], back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], 1)


KEY = Lamp("sun", np.array([3.0, 2, 1]), rotation=shining(-1, 0.3, -0.4), angle_rad=0.01, group="key")
FILL = Lamp("point", np.array([1.0, 2, 6]), np.array([-0.2, -0.3, 0.3]), radius_m=0.02)
SKY = Sky(np.random.default_rng(0).uniform(0.1, 0.4, (8, 16, 3)), "sky")
LIGHT = Light((KEY, FILL), SKY)


@pytest.fixture(scope="module")
def renderer(hand):
    avatar = new_avatar("untrained", hand.name, hand.sha256, SMALL)
    surface = surface_of_person(Person(melanin=0.2, folds=1.2, veins_mm=0.3), hand.sha256)
    avatar = replace(avatar, sky=Sky(np.full((4, 8, 3), 0.25)), surface=surface)
    return Renderer(avatar, hand, "cpu")


@pytest.fixture(scope="module")
def shot(hand):
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), -hand.joints[4])
    K = np.array([[210.0, 0, 33], [0, 210, 44], [0, 0, 1]])
    camera = Camera(K, look_at(np.array([0.1, 0.6, 0.2]), np.zeros(3), np.array([1.0, 0, 0])), SIZE)
    return Shot(pose, posed_vertices(hand, pose), camera, LIGHT)


def test_the_frame_is_the_sum_of_its_light_groups(renderer, shot):
    whole = renderer.render(shot)
    parts = [renderer.render(replace(shot, light=LIGHT.of_group(name))) for name in LIGHT.groups]
    assert LIGHT.groups == ("key", "", "sky")
    summed = sum(part.rgb for part in parts)
    assert np.abs(summed - whole.rgb).mean() / whole.rgb.mean() < 1e-5
    assert all(np.array_equal(part.alpha, whole.alpha) for part in parts)
    assert min(part.rgb.mean() for part in parts) > 0.02 * whole.rgb.mean()


@pytest.mark.parametrize("factor", [1e-4, 1e4])
def test_brightness_is_proportional_to_the_light_over_eight_decades(renderer, shot, factor):
    lamps = tuple(replace(lamp, rgb=factor * lamp.rgb) for lamp in LIGHT.lamps)
    scaled = renderer.render(replace(shot, light=Light(lamps, replace(SKY, radiance=factor * SKY.radiance))))
    whole = renderer.render(shot).rgb
    assert np.abs(scaled.rgb / factor - whole).max() < 1e-4 * whole.max()


def test_no_light_is_black_and_none_given_is_the_captures(renderer, shot):
    dark = renderer.render(replace(shot, light=Light()))
    assert dark.rgb.max() == 0
    assert dark.alpha.max() == 1
    own = renderer.render(replace(shot, light=None))
    same = renderer.render(replace(shot, light=Light(sky=renderer.avatar.sky)))
    assert np.array_equal(own.rgb, same.rgb)
    assert own.rgb.max() > 0


def test_only_what_the_light_changes_is_rendered_anew(renderer, shot):
    def stages(one):
        seen = []
        renderer.render(one, on_stage=seen.append)
        return seen

    other_view = replace(shot, camera=shot.camera.cropped(1, 0, SIZE))
    renderer.render(shot)
    assert stages(replace(shot, light=Light((FILL,)))) == ["pose", "light"]
    assert "superres" in stages(other_view)
    assert "superres" in stages(replace(shot, vertices=shot.vertices + 1e-4))


def test_a_kept_hand_gives_the_frame_of_a_fresh_one(hand, renderer, shot):
    renderer.render(replace(shot, light=Light((FILL,))))
    fresh = Renderer(renderer.avatar, hand, "cpu").render(shot)
    assert np.array_equal(renderer.render(shot).rgb, fresh.rgb)


@pytest.mark.parametrize("light", [LIGHT, None], ids=["lamps and sky", "the capture's sky"])
def test_both_backends_render_the_same(hand, renderer, shot, light):
    shot = replace(shot, light=light)
    slow = Renderer(renderer.avatar, hand, "cpu", backend=ReferenceBackend()).render(shot)
    fast = renderer.render(shot)
    assert np.abs(slow.rgb - fast.rgb).mean() < 0.01 * slow.rgb.mean()
    assert np.abs(slow.alpha - fast.alpha).mean() < 2e-3


def test_a_lamp_lights_its_own_side(renderer, shot):
    """A sun from the right of the image lights the right of the hand more than one from the left."""
    right = -shot.camera.cam2world[:3, 0]
    frames = [
        renderer.render(replace(shot, light=Light((replace(KEY, rotation=shining(*side)),))))
        for side in (right, -right)
    ]
    columns = [(frame.rgb.sum((0, 2)) * np.arange(SIZE[0])).sum() / frame.rgb.sum() for frame in frames]
    assert columns[0] > columns[1] + 2


IN_THE_WINDOW = sky_directions(32, 64) @ -KEY.direction > np.cos(0.3)
WINDOW = Light(sky=Sky(np.where(IN_THE_WINDOW, 5.0, 0.0)[..., None].repeat(3, 2)), shadow_quality="fine")


@pytest.mark.parametrize("light", [Light((KEY,)), WINDOW], ids=["lamp", "window"])
def test_a_slab_before_the_light_darkens_the_hand(renderer, shot, light):
    """A window of the sky is divided into many directions, each of which it blocks."""
    towards = -KEY.direction
    across = np.stack([KEY.rotation[:, 0], KEY.rotation[:, 1]])
    # Farther than the arm's end from the knuckles in the origin.
    slab = 0.4 * towards + np.array([[[-2, -2], [2, -2], [0, 3]]]) @ across
    blocked = renderer.render(replace(shot, light=replace(light, occluders=slab)))
    free = renderer.render(replace(shot, light=light))
    assert blocked.rgb.sum() < 0.02 * free.rgb.sum()


def test_clear_rays_of_a_known_surface_are_filled(hand, renderer, shot, monkeypatch):
    """Each pixel that shows the surface has a ray, and the picture is of what `filled` makes of them."""

    def half_as_bright(low, pixel, size_px, hits, edge_m):
        assert len(pixel) == len(hits.depth) == len(low.alpha)
        return low._replace(channels=low.channels / 2, alpha=low.alpha)

    before = renderer.render(shot)
    monkeypatch.setattr("livehand.backend.render.relightable.inpaint", half_as_bright)
    after = Renderer(renderer.avatar, hand, "cpu").render(shot)
    assert after.rgb.mean() < 0.9 * before.rgb.mean()


def test_shadows_are_of_the_known_surface_and_of_all_its_faces_in_frames_that_are_kept(renderer, shot, monkeypatch):
    asked, shadow_casters = [], HitSurface.shadow_casters

    def watched(surface, is_finest):
        asked.append(is_finest)
        return shadow_casters(surface, is_finest)

    monkeypatch.setattr(HitSurface, "shadow_casters", watched)
    frames = [renderer.render(replace(shot, light=Light((KEY,), shadow_quality=each))) for each in ("none", "fine")]
    assert asked == [False, True]
    monkeypatch.setattr(HitSurface, "shadow_casters", lambda surface, is_finest: None)
    by_mesh = renderer.render(replace(shot, light=Light((KEY,), shadow_quality="none")))
    change = np.abs(frames[0].rgb - by_mesh.rgb).mean() / by_mesh.rgb.mean()
    assert 0 < change < 0.1


def test_of_what_moves_lamps_shadows_are_of_the_meshs_faces_on_the_surface(renderer, shot, monkeypatch):
    asked, shadow_caster, light = [], HitSurface.shadow_caster, Light((KEY,), shadow_quality="none")
    monkeypatch.setattr(
        HitSurface, "shadow_caster", lambda surface, faces: asked.append(shadow_caster(surface, faces)) or asked[-1]
    )
    moving = renderer.render(replace(shot, quality="preview", light=light))
    ((mesh, faces, _),), kept = asked, renderer.pipeline._last.gbuffer
    assert torch.equal(faces, kept.met.hand.topology.faces)
    assert torch.equal(mesh.vertices, kept.layer.hit.mesh.vertices[: len(shot.vertices)])
    resting = renderer.render(replace(shot, light=light))
    on_hand = resting.alpha > 0.99
    assert 0 < np.abs(moving.rgb - resting.rgb)[on_hand].mean() < 0.08 * resting.rgb[on_hand].mean()


def test_pixels_on_edges_of_the_known_surface_show_both_parts(renderer, shot):
    renderer.render(shot)
    pipeline = renderer.pipeline
    kept, backend = pipeline._last.gbuffer, pipeline.backend
    edges, image = kept.layer.edges, kept.image
    assert len(edges.pixel) > 10
    features = pipeline.features(kept, pipeline.visibility(kept, LIGHT), LIGHT)
    sharp = pipeline.colours(replace(kept, layer=None), features)
    found = pipeline.colours(kept, features)
    torch.testing.assert_close(found, backend.blended(sharp, image.alpha, image.depth, edges))
    changed = (found - sharp).abs().amax(0).flatten() > 1e-3 * float(sharp.max())
    assert 5 < changed.sum() == changed[edges.pixel].sum()


def test_a_mirrored_hand_in_mirrored_light_is_the_mirror_image(hand, renderer, shot):
    mirror = np.diag(MIRROR_POINT).astype(float)
    pose = replace(
        shot.pose, theta=shot.pose.theta * MIRROR_AXIS_ANGLE, transl=shot.pose.transl * MIRROR_POINT, side="left"
    )
    cam2world = shot.camera.cam2world.copy()
    flip = np.diag([-1.0, 1, 1])
    cam2world[:3, :3] = mirror @ cam2world[:3, :3] @ flip
    cam2world[:3, 3] = mirror @ cam2world[:3, 3]
    K = shot.camera.K.copy()
    K[0, 2] = SIZE[0] - K[0, 2]
    lamp = replace(KEY, rotation=mirror @ KEY.rotation @ flip)
    left = Shot(pose, shot.vertices * MIRROR_POINT, Camera(K, cam2world, SIZE), Light((lamp,)))
    ours = renderer.render(left).rgb[:, ::-1]
    theirs = renderer.render(replace(shot, light=Light((KEY,)))).rgb
    assert np.abs(ours - theirs).mean() < 0.03 * theirs.mean()


def test_a_known_skin_shows_where_it_is_wanted(hand, renderer, shot):
    plain = Renderer(renderer.avatar, hand, "cpu", has_skin_detail=False).render(shot)
    detailed = renderer.render(shot)
    assert not np.array_equal(plain.alpha, detailed.alpha)
    assert np.abs(plain.alpha - detailed.alpha).mean() < 0.05  # the outline alone
    share = np.abs(plain.rgb - detailed.rgb).mean() / plain.rgb.mean()
    assert 0.0005 < share < 0.3


@pytest.mark.parametrize("eye", [(0.1, 0.6, 0.2), (0.6, 0.0, 0.1), (-0.3, -0.2, -0.5)])
def test_whatever_is_opaque_has_a_depth(hand, renderer, shot, eye):
    """It is where the mesh is but for what the skin raises."""
    view_from = replace(shot.camera, cam2world=look_at(np.array(eye), np.zeros(3), np.array([1.0, 0.1, 0])))
    shot = shot.with_camera(view_from)
    frame = renderer.render(shot)
    solid = frame.alpha >= 0.5
    assert solid.sum() > 300
    assert (frame.depth[solid] < DEPTH_BACKGROUND).all()
    assert (frame.depth[~solid] == DEPTH_BACKGROUND).all()
    of_mesh = surface_maps(shot, hand).depth
    both = solid & (of_mesh < DEPTH_BACKGROUND)
    median, most = np.quantile(np.abs(frame.depth - of_mesh)[both], (0.5, 0.97))
    assert median < 6e-4
    assert most < 4e-3


def test_bf16_changes_little(hand, renderer, shot):
    rough = Renderer(renderer.avatar, hand, "cpu", precision="bf16").render(shot)
    exact = renderer.render(shot)
    assert np.abs(rough.rgb - exact.rgb).mean() < 0.02 * exact.rgb.mean()
    assert exact.rgb.max() * pi > 1
    assert torch.tensor(rough.rgb).isfinite().all()


def test_old_avatars_ignore_the_light(hand, shot):
    config = replace(SMALL, field=replace(SMALL.field, light="baked"), superres=SuperResConfig(width=8, depth=2))
    baked = Renderer(new_avatar("old", hand.name, hand.sha256, config), hand, "cpu")
    assert not baked.is_relightable
    assert np.array_equal(baked.render(shot).rgb, baked.render(replace(shot, light=None)).rgb)


def test_hair_lies_over_the_skin_and_its_light_adds_up(renderer, shot):
    bare, hairy = renderer.render(shot), renderer.render(replace(shot, hair=1.0))
    changed = np.abs(hairy.rgb - bare.rgb).max(-1) > 1e-3 * bare.rgb.mean()
    on_hand = bare.alpha > 0.99
    assert 0.02 < (changed & on_hand).sum() / on_hand.sum() < 0.7
    assert (hairy.alpha >= bare.alpha - 1e-6).all()
    np.testing.assert_array_equal(hairy.depth[on_hand], bare.depth[on_hand])
    parts = [renderer.render(replace(shot, hair=1.0, light=LIGHT.of_group(name))) for name in LIGHT.groups]
    assert np.abs(sum(part.rgb for part in parts) - hairy.rgb).mean() / hairy.rgb.mean() < 1e-5
    again = renderer.render(shot)
    np.testing.assert_allclose(again.rgb, bare.rgb, atol=1e-6)


def test_what_moves_is_shown_with_fewer_faces_and_what_rests_is_not(renderer, shot):
    """Nearly the same to the eye; and the hand that was kept is not taken for the other."""
    resting, moving, again = (renderer.render(replace(shot, quality=each)) for each in ("final", "preview", "final"))
    np.testing.assert_array_equal(again.rgb, resting.rgb)
    assert not np.array_equal(moving.rgb, resting.rgb)
    error = np.abs(moving.rgb - resting.rgb)[resting.alpha > 0.99].mean()
    assert error < 0.05 * resting.rgb[resting.alpha > 0.99].mean()
    assert np.abs(moving.alpha - resting.alpha).mean() < 2e-3


def test_what_moves_shows_no_hair(renderer, shot):
    bare, hairy = (renderer.render(replace(shot, quality="preview", hair=hair)) for hair in (0.0, 1.0))
    np.testing.assert_array_equal(hairy.rgb, bare.rgb)


def test_hair_of_the_left_hand_is_the_mirror_image_of_that_of_the_right(hand, renderer, shot):
    """Lit evenly, for lamps' maps are not mirrored."""
    even = Light(sky=Sky(np.full((4, 8, 3), 0.25)))
    mirror = np.diag(MIRROR_POINT).astype(float)
    pose = replace(
        shot.pose, theta=shot.pose.theta * MIRROR_AXIS_ANGLE, transl=shot.pose.transl * MIRROR_POINT, side="left"
    )
    cam2world = shot.camera.cam2world.copy()
    cam2world[:3, :3] = mirror @ cam2world[:3, :3] @ np.diag([-1, 1, 1])
    cam2world[:3, 3] = mirror @ cam2world[:3, 3]
    left = Shot(pose, posed_vertices(hand.for_side("left"), pose), replace(shot.camera, cam2world=cam2world), even)
    changes = [
        renderer.render(replace(one, hair=1.0)).rgb - renderer.render(one).rgb
        for one in (replace(shot, light=even), left)
    ]
    right, mirrored = changes[0], changes[1][:, ::-1]
    assert len(renderer.pipeline.surface.hairs.corners) > 2000  # the arm's, too
    assert np.abs(right - mirrored).mean() < 0.05 * np.abs(right).mean()


@pytest.mark.parametrize("hair", [-0.1, 1.1, float("nan")])
def test_hair_is_a_share(shot, hair):
    with pytest.raises(LiveHandError, match="a share from 0 to 1"):
        replace(shot, hair=hair)


def test_a_shot_of_another_quality_is_refused(shot):
    other = copy(shot)
    object.__setattr__(other, "quality", "moving")  # tests' type checker would refuse it first
    with pytest.raises(LiveHandError, match="must be 'preview' or 'final', got 'moving'"):
        other.__post_init__()


def test_pressed_skin_is_paler_there_and_nowhere_else(renderer, shot):
    """Light that the skin scatters grows by what its blood takes away: hardly of red, most of blue."""
    shot = replace(shot, light=Light(sky=Sky(np.ones((4, 8, 3)))))
    pressed_m = np.full(len(shot.vertices), 0.0008)
    before, everywhere = renderer.render(shot), renderer.render(replace(shot, pressed_m=pressed_m))
    halved = renderer.render(replace(shot, pressed_m=pressed_m * (shot.vertices[:, 0] > 0)))
    is_skin = before.alpha == 1
    grown = everywhere.rgb[is_skin] / before.rgb[is_skin]
    most = np.exp(-0.6 * 0.8 * np.array(BLOOD_LOG_ALBEDO))
    assert (grown > 0.999).all()
    assert (grown < most + 0.01).all()
    assert (np.median(grown, 0) > 1 + 0.6 * (most - 1)).all()
    stays, follows = (
        np.isclose(halved.rgb, frame.rgb, rtol=1e-4)[is_skin].all(-1).mean() for frame in (before, everywhere)
    )
    assert min(stays, follows) > 0.1
    assert stays + follows > 0.9
    assert np.array_equal(halved.alpha, before.alpha)
    assert np.array_equal(renderer.render(shot).rgb, before.rgb)


def test_a_pressed_fingertips_nail_is_paler(renderer, shot, hand):
    """Seen from the back of the hand, where nothing is pressed: the nail alone."""
    middle = shot.vertices[hand.lbs_weights[:, 3] > 0.5].mean(0)
    is_pad = (hand.lbs_weights[:, 3] > 0.9) & (shot.vertices[:, 1] < middle[1] - 0.004)
    place = look_at(middle + np.array([0, 0.2, 0]), middle, np.array([0.0, 0, 1]))
    camera = Camera(np.array([[900.0, 0, 64], [0, 900, 64], [0, 0, 1]]), place, (128, 128))
    shot = replace(shot, light=Light(sky=Sky(np.ones((4, 8, 3)))), camera=camera)
    before, pressed = renderer.render(shot), renderer.render(replace(shot, pressed_m=np.where(is_pad, 0.001, 0.0)))
    is_skin = before.alpha == 1
    grown = pressed.rgb[is_skin] / before.rgb[is_skin]
    assert 0.01 < (grown[:, 2] > 1.05).mean() < 0.5
    assert np.median(grown[:, 2]) == pytest.approx(1, abs=1e-3)


def test_a_bent_joint_of_drawn_blood_is_paler_and_at_rest_nothing_changes(renderer, shot, hand):
    """On the back of the index finger's middle joint: brighter by what leaves it, hardly in red."""
    drains = np.full(16 * len(hand.v_template) - 30, 60, np.uint8)
    surface = renderer.avatar.surface
    drawn = Renderer(
        replace(renderer.avatar, surface=replace(surface, arrays={**surface.arrays, "drains": drains})), hand, "cpu"
    )
    shot = replace(shot, light=Light(sky=Sky(np.ones((4, 8, 3)))))
    np.testing.assert_array_equal(drawn.render(shot).rgb, renderer.render(shot).rgb)
    theta = np.zeros((16, 3))
    theta[2] = np.deg2rad(80) * load_surface_detail(hand.sha256).bend.flexion[2]
    pose = replace(shot.pose, theta=theta)
    middle = bone_frames(hand, pose)[2, :3, 3]
    place = look_at(middle + np.array([0, 0.2, 0]), middle, np.array([0.0, 0, 1]))
    camera = Camera(np.array([[1200.0, 0, 40], [0, 1200, 40], [0, 0, 1]]), place, (80, 80))
    shot = replace(shot, pose=pose, vertices=posed_vertices(hand, pose), camera=camera)
    before, bent = (one.render(shot) for one in (renderer, drawn))
    at = slice(36, 44), slice(36, 44)
    assert (before.alpha[at] == 1).all()
    grown = (bent.rgb[at] / before.rgb[at]).reshape(-1, 3)
    most = np.exp(-0.6 * place_log_albedo(0.2))
    assert (grown < most + 0.01).all()
    assert (np.median(grown, 0) > 1 + 0.6 * (most - 1)).all()


def test_what_is_no_pressing_is_refused(shot):
    count = len(shot.vertices)
    for pressed_m in (np.zeros(3), np.full(count, -1e-4), np.full(count, np.nan)):
        with pytest.raises(LiveHandError, match="pressed_m must be"):
            replace(shot, pressed_m=pressed_m)
