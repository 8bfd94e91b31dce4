"""Captures with light: instants of light groups, mixtures, and training that follows them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import new_avatar
from livehand.backend.capture.capture import Capture, SurfaceReference, save_capture_index
from livehand.backend.capture.exr import write_exr
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.capture.person import Person
from livehand.backend.evaluation.report import summary
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.light.lighting import COEFFICIENTS
from livehand.backend.light.samples import LightSamples
from livehand.backend.light.shadow_maps import Bounds
from livehand.backend.light.sky_samples import SKY_DIRECTIONS
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Light, Sky
from livehand.backend.records.shot import Shot
from livehand.backend.render import gbuffer
from livehand.backend.render.posed_surface import SurfacePixels
from livehand.backend.render.renderer import Renderer
from livehand.backend.surface.base_surface import surface_of_person
from livehand.backend.surface.surface_file import surface_sha256, write_surface
from livehand.backend.training.config import LossConfig, TrainConfig
from livehand.backend.training.lit_views import LitTrainingViews, exposure_of, group_weights, mixed
from livehand.backend.training.loop import Training, train
from livehand.backend.training.setup import TrainingSetup, sky_of
from livehand.backend.training.step import render_view
from livehand.tests.builders import scores_of

SUNSET_RGB = np.array([2.0, 1.0, 0.5])


@pytest.fixture(scope="module")
def lit_views(lit_capture, hand, small, cpu):
    return LitTrainingViews(lit_capture, lit_capture.of_split("train"), hand, small.sampler, cpu, 0)


def test_images_of_one_instant_are_one_view(lit_views, lit_capture):
    assert len(lit_capture.of_split("train")) == 12
    assert len(lit_views) == 6
    view = lit_views.get(0, 0)
    assert view.light.targets.shape[0] == 2
    groups = view.light.groups
    assert groups.lamps.rgb.tolist() == [[3, 3, 3]]
    assert groups.group_of_lamp.tolist() == [1]
    assert groups.skies[1].flux.abs().max() == 0
    assert view.light.visibility.shadows.sky.lit.shape == (64, len(view.rays.pixel))


def test_a_mixture_is_the_sum_of_weighted_images_and_lights(lit_views):
    view = lit_views.get(2, 0)
    generator = torch.Generator().manual_seed(5)
    weights = group_weights(2, torch.Generator().manual_seed(5))
    one = mixed(view, generator)
    linear = (view.light.targets * weights[:, :, None, None]).sum(0)
    torch.testing.assert_close(one.target[:3], one.light.encoded(linear))
    samples, groups = one.light.visibility.samples, view.light.groups
    torch.testing.assert_close(samples.sky.flux, groups.skies[0].flux * weights[0])
    torch.testing.assert_close(samples.lamps.rgb, groups.lamps.rgb * weights[1])


def test_weights_are_varied_and_never_all_zero():
    drawn = torch.stack([group_weights(3, torch.Generator().manual_seed(seed)) for seed in range(300)])
    assert drawn.amax((1, 2)).min() > 0
    assert 0.05 < (drawn == 0).float().mean() < 0.25
    assert drawn.std() > 0.5


def test_the_exposure_brings_the_brightest_to_nine_tenths():
    linear = torch.rand(3, 20, 20) * 7
    alpha = torch.ones(20, 20)
    dim = torch.tensor(1e-3)
    exposed = linear * exposure_of(linear, alpha, dim)
    assert float(exposed.quantile(0.99)) == pytest.approx(0.9, rel=0.01)
    assert exposure_of(linear, torch.zeros(20, 20), dim) == 1
    assert exposure_of(1e-6 * linear, alpha, dim) == pytest.approx(0.9 / 1e-3)  # no light is not made any


def test_noise_is_not_exposed_where_no_light_arrives(lit_views):
    """A view from behind, say: next to nothing comes back of a sun and a sky of some 1."""
    view = lit_views.get(2, 0)
    dark = view._replace(light=view.light._replace(targets=1e-7 * view.light.targets))
    assert mixed(dark, torch.Generator().manual_seed(5)).target[:3].max() < 0.01
    assert mixed(view, torch.Generator().manual_seed(5)).target[:3].max() > 0.9


def test_occluders_shadow_the_light_but_not_the_coefficients(lit_views):
    index = next(i for i, view in enumerate(lit_views.views) if view.camera_index == 1)
    visibility = lit_views.get(index, 0).light.visibility
    assert visibility.shadows.lamps.lit.max() == 0
    assert visibility.sky_visibility.lit.mean() > visibility.shadows.sky.lit.mean()


def test_light_groups_among_other_objects_are_refused(lit_capture, hand, small, cpu):
    other = replace(lit_capture.lights[0].light, occluders=np.eye(3)[None], occluder_albedo=np.full((1, 3), 0.5))
    lights = (replace(lit_capture.lights[0], light=other),)
    odd = replace(lit_capture, lights=lights + lit_capture.lights[1:])
    with pytest.raises(LiveHandError, match="same occluders"):
        LitTrainingViews(odd, odd.of_split("train"), hand, small.sampler, cpu, 0)


def test_an_image_whose_light_is_not_known_is_refused(lit_capture, hand, small, cpu):
    views = tuple(replace(view, light=None) for view in lit_capture.of_split("train"))
    with pytest.raises(LiveHandError, match="light of every image"):
        LitTrainingViews(lit_capture, views, hand, small.sampler, cpu, 0)


@pytest.fixture
def known_skin_views(lit_capture, hand, small, cpu):
    """Of a capture that has the surface of its hand."""
    surface = surface_of_person(Person(melanin=0.2, folds=1.0, veins_mm=0.2), hand.sha256)
    write_surface(lit_capture.folder / "surface.npz", surface)
    known = replace(lit_capture, surface=SurfaceReference("surface.npz", surface_sha256(surface)))
    return LitTrainingViews(known, known.of_split("train"), hand, small.sampler, cpu, 0)


def test_a_known_skin_is_trained_with_its_outline_and_detail(known_skin_views, lit_views, lit_config, hand):
    """Colours are the surface's; alpha stays the field's, which would else learn nothing of it."""
    assert lit_views.get(0, 0).light.surface is None
    view = mixed(known_skin_views.get(0, 0), torch.Generator().manual_seed(5))
    skin, hits = view.light.surface
    avatar = new_avatar("a", hand.name, hand.sha256, lit_config, seed=1)
    even = skin._replace(albedo=torch.ones_like(skin.albedo), nail=0 * skin.nail)
    variants = {
        "none": None,
        "even": even,
        "dark": even._replace(albedo=0.5 * even.albedo),
        "outside": even._replace(coverage=0 * even.coverage),
    }
    shown = {}
    for name, of_skin in variants.items():
        met = view.light.met._replace(hits=of_skin and hits)
        light = view.light._replace(surface=of_skin and SurfacePixels(of_skin, hits), met=met)
        shown[name] = render_view(avatar, known_skin_views, view._replace(light=light)).image.detach()
        torch.testing.assert_close(shown[name][3], shown["none"][3])
    assert shown["dark"][:3].sum() < 0.9 * shown["even"][:3].sum()
    assert shown["outside"][:3].abs().max() == 0
    assert skin.albedo.std() > 0.01
    lengths = hits.normal.norm(dim=-1)[hits.depth.isfinite()]
    assert len(lengths) > 0.7 * len(hits.depth)
    torch.testing.assert_close(lengths, torch.ones(len(lengths)), atol=2e-3, rtol=0)
    met = view.light.met._replace(hits=hits._replace(normal=-hits.normal))
    turned = view.light._replace(surface=SurfacePixels(even, met.hits), met=met)
    dark = render_view(avatar, known_skin_views, view._replace(light=turned)).image.detach()
    assert dark[:3].sum() < 0.9 * shown["even"][:3].sum()
    torch.testing.assert_close(skin.normal.norm(dim=-1), torch.ones(len(skin.row)), atol=2e-3, rtol=0)
    assert (skin.coverage == 1).any()
    assert ((skin.coverage > 0) & (skin.coverage < 1)).any()


def test_clear_rays_beside_a_known_skin_lend_no_light(known_skin_views, lit_config, hand, monkeypatch):
    """As when it is rendered: were all rays behind the skin, its pixels would have other light."""
    view = mixed(known_skin_views.get(0, 0), torch.Generator().manual_seed(5))
    avatar = new_avatar("a", hand.name, hand.sha256, lit_config, seed=1)
    plain = render_view(avatar, known_skin_views, view).image.detach()

    def without_most(points, alpha, hits, edge_m):
        assert len(alpha) == len(hits.depth) == len(points.position)
        some = torch.arange(len(alpha))[:, None] % 3 > 0
        return points._replace(position=points.position + some * 100 * edge_m * points.view)

    monkeypatch.setattr(gbuffer, "drop_outliers", without_most)
    other = render_view(avatar, known_skin_views, view).image.detach()
    assert (other[:3] - plain[:3]).abs().amax(0).gt(1e-3).sum() > 100
    assert torch.equal(other[3], plain[3])


def test_a_pose_that_moves_gets_its_skin_anew(known_skin_views):
    views = known_skin_views
    before, hits_before = views.get(0, 0).light.surface
    theta = torch.as_tensor(views.capture.poses[views.views[0].pose_index].theta, dtype=torch.float32) + 0.3
    mesh = views.get(0, 0).mesh
    views.move_pose(views.views[0].pose_index, theta, mesh.vertices + 0.002)
    after, hits_after = views.get(0, 0).light.surface
    assert not torch.equal(hits_before.depth, hits_after.depth)
    assert len(before.row) != len(after.row) or not torch.equal(before.albedo, after.albedo)


def test_windows_of_a_sky_cast_soft_shadows_in_training_too(lit_capture, hand, small, cpu):
    """All groups in the directions that a kept frame would take; how open skin lies is told by the whole cells."""
    bright = np.full((16, 32, 3), 0.1)
    bright[4:7, 8:12] = 9
    window = tuple(
        replace(one, light=replace(one.light, sky=Sky(bright))) if one.light.sky else one for one in lit_capture.lights
    )
    capture = replace(lit_capture, lights=window)
    view = LitTrainingViews(capture, capture.of_split("train"), hand, small.sampler, cpu, 0).get(0, 0)
    kept = LightSamples.of(replace(window[0].light, shadow_quality="fine"), Bounds.of(view.mesh)).sky
    assert len(kept.towards) > SKY_DIRECTIONS
    groups, visibility = view.light.groups, view.light.visibility
    for sky in groups.skies:
        assert torch.equal(sky.towards, kept.towards)
    torch.testing.assert_close(groups.skies[0].flux, kept.flux)
    assert len(visibility.shadows.sky.lit) == len(kept.towards)
    assert len(visibility.sky_visibility.lit) == SKY_DIRECTIONS


def test_the_avatar_keeps_the_sky_of_the_capture(lit_capture, painted_capture):
    assert np.array_equal(sky_of(lit_capture).radiance, np.full((4, 8, 3), 0.3))
    assert sky_of(painted_capture) is None


@pytest.fixture(scope="module")
def taught_capture(painted_capture, lit_capture, hand, lit_config, tmp_path_factory):
    """What another avatar shows in the sky and in the sun; held out: in coloured light of both."""
    folder = tmp_path_factory.mktemp("taught")
    teacher = new_avatar("teacher", hand.name, hand.sha256, lit_config, seed=1)
    generator = torch.Generator().manual_seed(2)
    with torch.no_grad():
        for values in (teacher.field.channels.bias, teacher.field.channels.weight):
            values[:COEFFICIENTS] += 0.5 * torch.randn(values[:COEFFICIENTS].shape, generator=generator)
    renderer, views = Renderer(teacher, hand, "cpu"), []
    sky, sun = (one.light for one in lit_capture.lights[:2])
    sunset = Light((replace(sun.lamps[0], rgb=SUNSET_RGB),), sky.sky)
    lights = tuple(CaptureLight("key", light) for light in (sky, sun, sunset))
    for view in painted_capture.views:
        pose = painted_capture.poses[view.pose_index]
        for index in (0, 1) if view.split == "train" else (2,):
            frame = renderer.render(Shot(pose, posed_vertices(hand, pose), view.camera, lights[index].light))
            name = f"{view.file[:-4]}_{index}.exr"
            write_exr(folder / name, {"A": frame.alpha} | {name: frame.rgb[..., k] for k, name in enumerate("RGB")})
            views.append(replace(view, file=name, light=index))
    known = (painted_capture.hand_sha256, {"made_by": "test"}, painted_capture.poses)
    capture = Capture(folder, *known, tuple(views), lights)
    save_capture_index(capture)
    return capture


def test_training_from_nothing_learns_a_hand_in_lights_it_has_not_seen(
    taught_capture, hand, lit_config, compute, silent, tmp_path
):
    def hand_db(avatar):
        scores = scores_of(Renderer(avatar, hand, "cpu"), taught_capture, taught_capture.of_split("test"))
        return summary(scores)["psnr_hand"]

    config = TrainConfig(steps=40, warmup_steps=5, checkpoint_every=100, loss=LossConfig(perceptual=0.0))
    setup = TrainingSetup(taught_capture, hand, lit_config)
    before = hand_db(new_avatar("a", hand.name, hand.sha256, lit_config))
    result = train(setup, config, tmp_path / "a.safetensors", compute, silent)
    assert before < 20
    assert hand_db(result.avatar) > before + 8
    assert result.avatar.sky is not None
    assert result.avatar.thumbnail.shape == (192, 192, 4)


def test_a_baked_avatars_shape_and_planes_are_a_start(lit_capture, hand, small, lit_config, avatar, compute, tmp_path):
    from livehand.backend.training.setup import BaseAvatar

    setup = TrainingSetup(lit_capture, hand, lit_config, base=BaseAvatar(avatar, "0" * 64))
    training = Training(setup, TrainConfig(steps=1), tmp_path / "b.safetensors", compute)
    ours, theirs = training._avatar.field.state_dict(), avatar.field.state_dict()
    assert all(
        torch.equal(ours[key], theirs[key]) for key in ours if key.startswith(("planes", "relief", "near", "density"))
    )
    assert ours["channels.weight"].shape != theirs["channels.weight"].shape
