"""Textures: a known one drawn, wrapped and drawn again; texels, holes and the flattest pose."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.evaluation.shot_renderer import ShotRenderer
from livehand.backend.field.rays import ray_directions
from livehand.backend.geometry.uvh import atlas_uv, interpolate
from livehand.backend.records.errors import LiveHandError
from livehand.backend.research.baselines.drawing import drawn_surface
from livehand.backend.research.baselines.mesh_wrapping import MESH_TEXTURE, MESH_WRAPPING, PICTURE_FILE, flattest_pose
from livehand.backend.research.baselines.texture import TextureSum, dilated, draw_textured, sampled, texels_of
from livehand.backend.research.baselines.weights_file import FILE, load_method
from livehand.tests.builders import scores_of
from PIL import Image

SIDE = 256


def painted(hand, resolution):
    """A smooth function of the place on the skin, so that it has no seams."""
    texels = texels_of(hand.topology, resolution)
    x, y, z = interpolate(hand.mesh.vertices, hand.topology, texels.samples).T
    colour = torch.stack([0.5 + 0.4 * torch.sin(90 * x), 0.5 + 0.4 * torch.cos(70 * y), 0.4 + 0.3 * torch.sin(80 * z)])
    return dilated(texels.texel, colour.T.contiguous(), resolution)


def psnr_db(a, b):
    return float(-10 * torch.log10(((a - b) ** 2).mean()))


def test_a_texel_lies_where_its_surface_point_is_on_the_atlas(posed):
    topology = posed("open").topology
    texels = texels_of(topology, SIDE)
    assert 0.45 < len(texels.texel) / SIDE**2 < 0.58
    assert len(texels.texel.unique()) == len(texels.texel)
    centre = torch.stack([texels.texel % SIDE, texels.texel // SIDE], -1) + 0.5
    assert (atlas_uv(topology, texels.samples) * SIDE - centre).abs().max() < 1e-2


def test_sampling_is_bilinear_between_texel_centres():
    image = torch.tensor([[[0.0, 1.0], [2.0, 3.0]]])
    spots = torch.tensor([[0.25, 0.25], [0.5, 0.25], [0.5, 0.5], [0.0, 0.0], [1.0, 1.0]])
    torch.testing.assert_close(sampled(image, spots)[:, 0], torch.tensor([0.0, 0.5, 1.5, 0.0, 3.0]))


def test_charts_grow_by_four_texels():
    index = torch.tensor([10 * 20 + 10])
    grown = dilated(index, torch.tensor([[0.5, 0.6, 0.7]]), 20)
    assert (grown[10, 6:15] > 0).all()
    assert (grown[10, :6] == 0).all()
    assert (grown[10, 15:] == 0).all()


@pytest.mark.parametrize("gesture", ["open", "fist"])
def test_a_texture_drawn_wrapped_and_drawn_again_is_the_same(posed, view_from, gesture):
    """From the views that it was wrapped from, and inside the silhouette."""
    hand = posed(gesture)
    texture = painted(hand, 512)
    views = [view_from(hand.mesh, d, (240, 220)) for d in ([0, 1, 0.2], [0, -1, 0.1], [0.3, 0.2, 1], [0, 0.3, -1])]
    total = TextureSum(texels_of(hand.topology, 512), hand.topology)
    for view in views:
        total.add(draw_textured(texture, hand.mesh, hand.topology, view)[0], hand.mesh, view)
    wrapped, filled = total.finished(hand.mesh.vertices)
    assert 0.02 < filled < 0.6
    for view in views:
        first, again = (draw_textured(t, hand.mesh, hand.topology, view)[0] for t in (texture, wrapped))
        torch.testing.assert_close(first[3], again[3])
        inside = -torch.nn.functional.max_pool2d(-(first[3:4] > 0.99).float(), 5, 1, 2)[0] > 0.5
        cosine = facing(hand, view)
        seen = inside & (cosine > 0.3)
        assert psnr_db(first[:3, seen], again[:3, seen]) > 40


def facing(hand, view):
    """[H, W] cosine between each pixel's surface and its ray."""
    surface = drawn_surface(hand.mesh, hand.topology, view)
    normal = torch.nn.functional.normalize(interpolate(hand.mesh.normals, hand.topology, surface.samples), dim=-1)
    ray = torch.nn.functional.normalize(ray_directions(view, surface.pixel), dim=-1)
    width, height = view.size_px
    flat = torch.zeros(width * height).index_put((surface.pixel,), -(normal * ray).sum(-1))
    return flat.reshape(height, width)


def test_what_no_view_saw_has_the_nearest_seen_colour(posed):
    hand = posed("open")
    total = TextureSum(texels_of(hand.topology, 64), hand.topology)
    total._weight[::2] = 1.0
    total._colour[::2] = torch.tensor([0.2, 0.4, 0.6])
    texture, filled = total.finished(hand.mesh.vertices)
    assert filled == pytest.approx(0.5, abs=0.01)
    torch.testing.assert_close(
        texture.reshape(-1, 3)[total.texels.texel].unique(dim=0), torch.tensor([[0.2, 0.4, 0.6]])
    )


def test_the_flattest_pose_is_found_among_those_that_are_seen(painted_capture):
    relaxed, opened = painted_capture.poses
    views = painted_capture.views
    bent = replace(relaxed, theta=relaxed.theta * 3)
    assert flattest_pose((bent, opened), views) == 1
    assert flattest_pose((opened, bent), views) == 0
    assert flattest_pose((opened, bent), [view for view in views if view.pose_index == 1]) == 1


def test_both_rows_render_the_capture_and_are_no_avatars(painted_capture, hand, machine, two_steps, cpu, tmp_path):
    scores = {}
    for method in (replace(MESH_WRAPPING, resolution=128), replace(MESH_TEXTURE, resolution=128)):
        fitted = method.fit(painted_capture, hand, two_steps, tmp_path / method.name, machine)
        assert fitted.steps == 0
        assert "%" in fitted.remarks
        with Image.open(tmp_path / method.name / PICTURE_FILE) as picture:
            drawn = torch.as_tensor(np.array(picture)).flip(0) / 255
        learnt = load_method(tmp_path / method.name, method.name)[0]["texture"]
        torch.testing.assert_close(drawn, learnt.float().clamp(0, 1), atol=0.003, rtol=0)
        renderer = method.load(tmp_path / method.name, hand, cpu)
        assert isinstance(renderer, ShotRenderer)
        scores[method.name] = scores_of(renderer, painted_capture, painted_capture.of_split("test"))
        with pytest.raises(LiveHandError, match="something else"):
            load_avatar(tmp_path / method.name / FILE)
    assert all(score.figures["psnr_full"] > 15 for scored in scores.values() for score in scored)
    assert all(score.figures["alpha_iou"] > 0.9 for scored in scores.values() for score in scored)
    with pytest.raises(LiveHandError, match="must hold a fitted mesh_texture"):
        MESH_TEXTURE.load(tmp_path / "mesh_wrapping", hand, cpu)
