"""Frames stage by stage in Warp, on its CPU device and a GPU if there is one, against the reference's; their launches.

By night: by day `test_stages` compares each stage, and `test_lit_frame` a frame whose light was measured.
"""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from livehand.backend.avatars.file import load_avatar
from livehand.backend.compute.gpu.backend import WarpBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Light
from livehand.backend.render.renderer import Renderer

from .conftest import AREAS, SKY, SLAB, SUN, shots

pytestmark = pytest.mark.slow

# As `test_cuda` has it.
VALUE = 2e-3
# Over an edge of the mesh, rounding decides which face a sample is of; at the atlas' seams another has other features,
# and super-resolution spreads them. The reference differs from itself in as many pixels if its camera moves by an ulp.
FLIPPED = 2e-2
MOST_LAUNCHES = 72
"""Of Warp's kernels: three shadow look-ups of five each, and the rest. Torch's networks and glue come on top."""


def renderer_of(backend, device):
    return Renderer(load_avatar(), load_default_hand(), device, "fp32", backend)


@pytest.fixture(scope="module")
def renderers(device):
    return renderer_of(WarpBackend(), device.type), renderer_of(ReferenceBackend(), "cpu")


def assert_same_frame(renderers, shot):
    ours, theirs = (renderer.render(shot) for renderer in renderers)
    for name in ("rgb", "alpha"):
        off = np.abs(getattr(ours, name) - getattr(theirs, name))
        assert (off > VALUE * max(1, theirs.rgb.max())).mean() < FLIPPED, name
    solid = (ours.alpha > 0.5) & (theirs.alpha > 0.5)
    assert solid.sum() > 300
    assert (np.abs(ours.depth - theirs.depth)[solid] > 5e-4).mean() < FLIPPED


@pytest.mark.nightly
@pytest.mark.parametrize("number", range(4))
def test_a_frame_is_the_references(renderers, number):
    """Right and left, kept and moving, past the border, lit by lamps and skies, beside a slab."""
    assert_same_frame(renderers, list(shots(load_default_hand()))[number])


@pytest.mark.nightly
def test_a_frame_in_the_captures_light_with_hair_and_a_faded_arm_is_the_references(renderers):
    shot = next(iter(shots(load_default_hand())))
    assert_same_frame(renderers, replace(shot, light=None, hair=1.0))


@pytest.mark.nightly
def test_light_that_changes_falls_on_the_kept_hand_as_the_references(renderers):
    shot = next(iter(shots(load_default_hand())))
    for light in (Light((SUN,)), Light(AREAS, SKY), Light((), SKY, SLAB, np.full((1, 3), 0.5))):
        assert_same_frame(renderers, replace(shot, light=light))


@pytest.mark.nightly
def test_launches_of_a_lit_frame(renderers, monkeypatch):
    launched, launch = [], wp.launch

    def counted(kernel, *given, **named):
        launched.append(kernel.key)
        launch(kernel, *given, **named)

    monkeypatch.setattr(wp, "launch", counted)
    renderers[0].forget()
    renderers[0].render(next(iter(shots(load_default_hand()))))
    assert 30 < len(launched) <= MOST_LAUNCHES, launched


def test_an_orthographic_camera_is_refused_in_words(renderers):
    shot = next(shots(renderers[0].hand))
    flat = replace(shot, camera=replace(shot.camera, is_orthographic=True))
    with pytest.raises(LiveHandError, match="perspective"):
        renderers[0].render(flat)
