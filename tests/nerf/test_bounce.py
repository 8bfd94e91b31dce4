"""Light from skin to skin: form factors in closed form, and on a hand."""

from math import pi

import pytest
import torch
from livehand.backend.nerf.bounce import PROBES, Probes, bounced, probe_vertices

UP, DOWN = torch.tensor([0.0, 0, 1]), torch.tensor([0.0, 0, -1])


def plane(height_m, side_m, normal, cells=200):
    """A square at a height, in equal discs."""
    at = (torch.arange(cells) + 0.5) / cells - 0.5
    x, y = (value.flatten() * side_m for value in torch.meshgrid(at, at, indexing="ij"))
    position = torch.stack([x, y, torch.full_like(x, height_m)], 1)
    return Probes(position, normal.expand(len(x), 3), torch.tensor((side_m / cells) ** 2))


def at(*places):
    return torch.tensor(places)


def test_a_disc_overhead_is_seen_by_its_form_factor():
    """On the axis of a disc of radius r at height h: r^2 / (r^2 + h^2)."""
    radius, height = 0.02, 0.03
    disc = Probes(at([0.0, 0, height]), DOWN[None], torch.tensor(pi * radius**2))
    found = bounced(torch.zeros(1, 3), UP[None], disc, at([1.0, 2.0, 0.5]))
    expected = radius**2 / (radius**2 + height**2)
    torch.testing.assert_close(found, expected * at([1.0, 2.0, 0.5]))


def test_a_wide_plane_covers_the_sky_and_what_lies_behind_counts_nothing():
    wide = plane(0.01, 0.4, DOWN)
    shed = torch.ones(len(wide.position), 3)
    normals = torch.stack([UP, DOWN, torch.tensor([1.0, 0, 0])])
    found = bounced(torch.zeros(3, 3), normals, wide, shed)[:, 0]
    assert found[0] == pytest.approx(1, abs=0.03)
    assert found[1] == 0
    assert found[2] == pytest.approx(0.5, abs=0.03)
    turned = wide._replace(normal=-wide.normal)
    assert bounced(torch.zeros(1, 3), UP[None], turned, shed).abs().max() == 0


def test_no_more_arrives_than_is_shed_however_near():
    near = plane(1e-5, 0.05, DOWN)
    shed = torch.rand(len(near.position), 3, generator=torch.Generator().manual_seed(0))
    found = bounced(torch.zeros(1, 3), UP[None], near, shed)
    assert (found <= shed.amax(0)).all()
    assert found.isfinite().all()
    same = bounced(near.position[:1], UP[None], near, shed)  # a point on the disc itself
    assert same.isfinite().all()


def test_probes_have_the_hands_area(posed):
    hand = posed("open")
    probes = Probes.of(hand.mesh, hand.topology)
    a, b, c = hand.mesh.vertices[hand.topology.faces].unbind(1)
    area_m2 = float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)
    assert float(probes.area_m2) * PROBES == pytest.approx(area_m2, rel=1e-4)
    assert len(probe_vertices(len(hand.mesh.vertices)).unique()) == PROBES


@pytest.mark.parametrize(("gesture", "share", "least", "most"), [("fist", 0.95, 0.6, 1.0), ("open", 0.1, 0.0, 0.05)])
def test_a_fist_lights_its_inside_and_an_open_hand_not_its_back(posed, gesture, share, least, most):
    hand = posed(gesture)
    probes = Probes.of(hand.mesh, hand.topology)
    found = bounced(hand.mesh.vertices, hand.mesh.normals, probes, torch.ones(PROBES, 3))[:, 0]
    assert least <= float(found.quantile(share)) <= most
