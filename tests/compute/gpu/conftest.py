"""What frames of 64 x 96 px in several lights give to each stage, for comparing backends stage by stage."""

from collections import defaultdict
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.light import Lamp, Light, Sky, rotation_facing
from livehand.backend.records.shot import HandPose
from livehand.backend.render import lit_shots
from livehand.backend.render.renderer import Renderer
from livehand.backend.research.benchmark.motion import MovingHand

collect_ignore_glob = [] if find_spec("warp") else ["test_*.py"]

SLAB = np.array([[[-0.3, -0.3, -0.3], [0.3, -0.3, -0.3], [0.0, -0.3, 0.3]]])


def area_lamp(position, rgb, size_m, **more):
    position = np.array(position, float)
    rotation = rotation_facing(position / np.linalg.norm(position))
    return Lamp("area", np.array(rgb, float), position, rotation, size_m=(size_m, size_m), **more)


SUN = Lamp("sun", np.array([3.0, 2, 1]), rotation=np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), angle_rad=0.01)
POINT = Lamp("point", np.array([1.0, 2, 6]), np.array([-0.2, -0.3, 0.3]), radius_m=0.03)
SPOT = Lamp(
    "spot", np.array([4.0, 4, 1]), np.array([0.0, -0.5, 0]), rotation_facing(np.array([0.0, -1, 0])), cone_rad=0.4
)
AREAS = area_lamp([-0.5, -0.6, 0.5], [6, 5, 4], 0.25, spread_rad=1.0), area_lamp([0.1, 0.6, 0.5], [5, 5, 5], 0.3)
SKY = Sky(np.abs(np.random.default_rng(0).normal(0.3, 0.1, (16, 32, 3))))


class Recorder(NumbaBackend):
    """Renders as numba does, rays chunk by chunk, and keeps what each stage is given."""

    ray_renderer = ReferenceBackend.ray_renderer
    frames_at_once = 1

    def __init__(self):
        self.calls = defaultdict(list)
        for name in vars(ReferenceBackend):
            stage = getattr(self, name)
            if not name.startswith("_") and callable(stage):
                setattr(self, name, self._recording(name, stage))

    def _recording(self, name, stage):
        def record(*given, **named):
            self.calls[name].append((given, named))
            return stage(*given, **named)

        return record


def shots(hand):
    """Right and left hands, moving and kept, whole and past the image's border, in every kind of light."""
    motion = MovingHand(hand, (64, 96))
    first, second = (motion.shot(motion.frames(8)[index]) for index in (1, 5))
    yield replace(first, light=Light((*AREAS, SUN), SKY))
    yield replace(second, light=Light((POINT, SPOT), SKY, SLAB, np.full((1, 3), 0.5)), quality="preview")
    yield replace(first, light=Light((SUN,), shadow_quality="fine"), camera=first.camera.cropped(20, 30, (40, 50)))
    # Moved sideways, the mirrored hand is as far before the camera as the other was.
    left = HandPose(first.pose.theta * MIRROR_AXIS_ANGLE, first.pose.beta, np.zeros(3), "left")
    there = posed_vertices(hand, left)
    moved = replace(left, transl=first.vertices.mean(0) - there.mean(0))
    yield replace(first, pose=moved, vertices=posed_vertices(hand, moved), light=Light((POINT,), SKY))


HAS_GPU = torch.cuda.is_available()


@pytest.fixture(
    scope="session",
    params=["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not HAS_GPU, reason="needs a CUDA GPU"))],
)
def device(request):
    """Where Warp computes; the reference computes on the CPU."""
    return torch.device(request.param)


@pytest.fixture(scope="session")
def calls():
    """Stage -> [(arguments, named arguments)] of the frames, without gradients."""
    hand, recorder = load_default_hand(), Recorder()
    renderer = Renderer(load_avatar(), hand, "cpu", "fp32", recorder)
    for shot in shots(hand):
        assert renderer.render(shot).alpha.max() > 0.9
        renderer.forget()
    return recorder.calls


@pytest.fixture(scope="session")
def hand():
    return load_default_hand()


@pytest.fixture(scope="session", autouse=True)
def small_buckets():
    """Frames of 64 x 96 px have half the rays then; those of the gates' rehearsal are as they are everywhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lit_shots, "BUCKET_PX", 16)
        yield


@pytest.fixture(scope="session")
def renderers(device, hand):
    """At once on Warp's device, and stage by stage on the CPU as everybody's frames are."""
    from livehand.backend.compute.gpu.backend import WarpBackend

    avatar, name = load_avatar(), "cuda:0" if device.type == "cuda" else "cpu"
    return (Renderer(avatar, hand, "cpu", "fp32", backend) for backend in (WarpBackend(name), NumbaBackend()))


@pytest.fixture(scope="session")
def ours(renderers):
    return next(renderers)


@pytest.fixture(scope="session")
def theirs(ours, renderers):
    return next(renderers)


@pytest.fixture(scope="session")
def first(hand):
    return next(iter(shots(hand)))
