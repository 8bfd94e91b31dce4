"""Sampling without the mesh: rays through the box, points on the nearest skin, and the row."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.evaluation.shot_renderer import ShotRenderer
from livehand.backend.field.near_skin import NearSkin
from livehand.backend.field.rays import project
from livehand.backend.geometry.uvh import interpolate
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.research.baselines.avatar_rows import AVATAR_FILE
from livehand.backend.research.baselines.hierarchical import HIERARCHICAL, box_rays


def test_points_near_the_skin_are_projected_onto_it(posed, nearest_face):
    hand = posed("open")
    generator = torch.Generator().manual_seed(0)
    on_skin = hand.mesh.vertices[hand.topology.faces[::7]].mean(1)
    normals = hand.mesh.normals[hand.topology.faces[::7]].mean(1)
    points = on_skin + 0.004 * (torch.rand(len(on_skin), 1, generator=generator) * 2 - 1) * normals
    found = NearSkin(hand.mesh, hand.topology).at(points)
    _, distance = nearest_face(points, hand.mesh.vertices[hand.topology.faces])
    exact = (found.height_m.abs() * hand.mesh.scale - distance).abs() < 1e-5
    assert exact.float().mean() > 0.97
    below = interpolate(hand.mesh.vertices, hand.topology, found)
    torch.testing.assert_close((points - below).norm(dim=1)[exact].double(), distance[exact], atol=1e-5, rtol=0)


def test_far_points_are_only_roughly_placed(posed):
    hand = posed("open")
    far = NearSkin(hand.mesh, hand.topology).at(hand.mesh.vertices.mean(0, keepdim=True) + 0.3)
    assert float(far.height_m) > 0.1
    assert float(far.barycentric.sum()) == pytest.approx(1)


def test_rays_cross_the_box_around_the_hand(posed, view_from):
    hand = posed("open")
    view = view_from(hand.mesh, [0, 1, 0.2])
    rays = box_rays(hand.mesh, view)
    positions_px, depth = project(view, hand.mesh.vertices)
    is_inside = ((positions_px >= 0) & (positions_px < torch.tensor(view.size_px))).all(1)  # the arm leaves the picture
    positions_px, depth = positions_px[is_inside], depth[is_inside]
    row = torch.full((view.size_px[0] * view.size_px[1],), -1).index_put((rays.pixel,), torch.arange(len(rays.pixel)))
    pixel = positions_px[:, 1].long() * view.size_px[0] + positions_px[:, 0].long()
    assert (row[pixel] >= 0).all()
    assert (rays.near[row[pixel]] < depth).all()
    assert (rays.far[row[pixel]] > depth).all()
    ends = torch.stack([rays.points(t[:, None])[:, 0] for t in (rays.near, rays.far)])
    assert (ends >= hand.mesh.vertices.amin(0) - 0.0051).all()
    assert (ends <= hand.mesh.vertices.amax(0) + 0.0051).all()


def test_the_papers_networks_look_alike_sampled_otherwise(painted_capture, hand, machine, two_steps, cpu, tmp_path):
    """Untrained, the field is a hull of the hand by its prior: both ways of sampling find it."""
    inference = replace(machine, is_inference_only=True)
    with pytest.raises(LiveHandError, match="row 'paper'"):
        HIERARCHICAL.fit(painted_capture, hand, two_steps, tmp_path / "hierarchical", inference)
    avatar = new_avatar("paper", hand.name, hand.sha256, PRESETS["paper"])
    (tmp_path / "paper").mkdir()
    save_avatar(avatar, tmp_path / "paper" / AVATAR_FILE)
    assert HIERARCHICAL.fit(painted_capture, hand, two_steps, tmp_path / "hierarchical", inference).steps == 0
    renderer = HIERARCHICAL.load(tmp_path / "hierarchical", hand, cpu)
    assert isinstance(renderer, ShotRenderer)
    pose, view = painted_capture.poses[0], painted_capture.views[0]
    shot = Shot(pose, posed_vertices(hand, pose), view.camera)
    ours, guided = renderer.render(shot), Renderer(avatar, hand, "cpu").render(shot)
    found, expected = ours.alpha > 0.5, guided.alpha > 0.5
    assert (found & expected).sum() / (found | expected).sum() > 0.85
    both = (ours.alpha > 0.9) & (guided.alpha > 0.9)
    assert np.abs(ours.rgb[both] - guided.rgb[both]).mean() < 0.02


def test_it_trains(painted_capture, hand, machine, two_steps, cpu, tmp_path):
    fitted = HIERARCHICAL.fit(painted_capture, hand, two_steps, tmp_path, machine)
    assert fitted.steps == 1
    assert fitted.parameters == 2 * 92_577 + 296_072
    assert HIERARCHICAL.load(tmp_path, hand, cpu).hand is hand
