"""Which faces of an avatar's surface a frame shows: of small pictures of what moves few, of close-ups curved ones."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.capture.person import Person
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.light import Lamp, Light
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.surface.base_surface import surface_of_person

pytestmark = pytest.mark.slow

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 3, 4), (128, 1, 4)), relief=8, light="linear"),
    SuperResConfig(kind="lit", width=8, depth=2),
    SamplerConfig(6, 0.003),
)
DISTANCE_M, SIZE_PX = 0.5, 64


@pytest.fixture(scope="module")
def renderer(hand):
    surface = surface_of_person(Person(melanin=0.2, folds=1.2, veins_mm=0.3), hand.sha256)
    return Renderer(replace(new_avatar("untrained", hand.name, hand.sha256, SMALL), surface=surface), hand, "cpu")


def shot_of(hand, mm_per_px, **numbers):
    """The radial outline of the index fingertip from the hand's back, before a lamp."""
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), -hand.joints[3] - np.array([0, 0, 0.0075]))
    focal_px, middle = 1000 * DISTANCE_M / mm_per_px, SIZE_PX / 2
    K = np.array([[focal_px, 0, middle], [0, focal_px, middle], [0, 0, 1]])
    camera = Camera(K, look_at(np.array([0, DISTANCE_M, 0]), np.zeros(3), np.array([1.0, 0, 0])), (SIZE_PX, SIZE_PX))
    light = Light((Lamp("point", np.ones(3), np.array([0.1, 0.4, 0.2])),))
    return Shot(pose, posed_vertices(hand, pose), camera, light, **numbers)


def posed(renderer, shot):
    pipeline = renderer.pipeline
    with torch.inference_mode():
        return pipeline.surface.posed(shot, pipeline.posed(shot).hand)


@pytest.mark.parametrize(("mm_per_px", "quality"), [(0.35, "final"), (0.1, "preview"), (0.35, "preview")])
def test_the_faces_of_ordinary_frames_and_of_what_moves_are_the_meshs(hand, renderer, mm_per_px, quality):
    surface = posed(renderer, shot_of(hand, mm_per_px, quality=quality))
    assert surface.shown is surface.mesh


def test_a_close_frame_shows_four_curved_faces_for_each(hand, renderer):
    shot = shot_of(hand, 0.1, pressed_m=np.full(len(hand.v_template), 0.0005))
    surface = posed(renderer, shot)
    count = len(surface.mesh.vertices)
    assert len(surface.shown.faces) == 4 * len(surface.mesh.faces)
    assert torch.equal(surface.shown.vertices[:count], surface.mesh.vertices)
    assert len(surface.pale.bloodless) == len(surface.shown.vertices)
    assert renderer.pipeline.surface.curved_faces("right") is renderer.pipeline.surface.curved_faces("right")


def test_edges_grow_round_before_they_are_all_arcs(hand, renderer):
    """Half-way between both limits, each middle has risen half as far."""
    near, far, middle = (posed(renderer, shot_of(hand, mm)) for mm in (0.1, 0.35, 0.24))
    count = len(near.mesh.vertices)
    chords = near.mesh.vertices[renderer.pipeline.surface.curved_faces("right").edges].mean(1)
    full, risen = near.shown.vertices[count:] - chords, middle.shown.vertices[count:] - chords
    share = float((risen * full).sum() / (full * full).sum())
    assert 0.1 < share < 0.9
    torch.testing.assert_close(risen, share * full, atol=1e-7, rtol=0)
    assert len(far.shown.vertices) == count


def test_image_and_rays_meet_curved_faces_and_the_mesh_casts_shadows(hand, renderer, monkeypatch):
    shot, backend, seen = shot_of(hand, 0.1), renderer.pipeline.backend, {}
    for name in ("visible_surface", "detailed_image", "ray_hits"):
        stage = getattr(backend, name)

        def watched(*given, name=name, stage=stage):
            mesh = next(each for each in given if hasattr(each, "coarse_faces"))
            seen[name] = len(mesh.faces)
            return stage(*given)

        monkeypatch.setattr(type(backend), name, staticmethod(watched))
    frame = renderer.render(shot)
    flat = len(renderer.pipeline.surface.levels("right").finest.faces)
    assert seen == {"visible_surface": 4 * flat, "detailed_image": 4 * flat, "ray_hits": 4 * flat}
    assert len(renderer.pipeline._last.gbuffer.layer.hit.mesh.faces) == flat
    monkeypatch.setattr("livehand.backend.render.posed_surface.roundness_in", lambda hand: 0.0)
    renderer.forget()
    straight = renderer.render(shot)
    differs = np.abs(frame.alpha - straight.alpha) > 0.02
    assert 5 < differs.sum() < 0.05 * differs.size
    is_skin = (frame.alpha == 1) & (straight.alpha == 1)
    assert np.abs(frame.rgb - straight.rgb)[is_skin].mean() < 0.02 * straight.rgb[is_skin].mean()
