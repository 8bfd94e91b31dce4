"""On a GPU: the same frames, gradients and commands as on the CPU. `make test-cuda`; skipped where there is none.

`make test-cuda REHEARSE=1` runs them on the CPU twice, which tells whether they run.
"""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig
from livehand.backend.avatars.file import load_avatar
from livehand.backend.capture.capture import SurfaceReference
from livehand.backend.capture.person import Person
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.light import Lamp, Light, Sky
from livehand.backend.render.renderer import Renderer
from livehand.backend.research.benchmark.motion import MovingHand
from livehand.backend.surface.base_surface import surface_of_person
from livehand.backend.surface.surface_file import surface_sha256, write_surface
from livehand.backend.system.command import run_commands
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.processes import ComputeSetup
from livehand.backend.training.setup import TrainingSetup
from livehand.livehand_blender.cli import COMMANDS

IS_REHEARSED = bool(os.environ.get("LIVEHAND_REHEARSE"))
GPU = "cpu" if IS_REHEARSED else "cuda"
pytestmark = pytest.mark.skipif(not IS_REHEARSED and not torch.cuda.is_available(), reason="needs a CUDA GPU")

# Sums are taken in another order, and a ray may fall on either side of an edge.
VALUE, FLIPPED = 2e-3, 2e-3
# The optimiser's first steps are as long for a gradient that is rounding noise, whose sign is chance.
NOISE = 0.01


BAKED = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)
LIT = replace(BAKED, field=replace(BAKED.field, light="linear"), superres=SuperResConfig(kind="lit", width=8, depth=2))


def frame_on(device, shot, precision="fp32"):
    """By the reference on the CPU too: numba stops a ray a little earlier."""
    return Renderer(load_avatar(), load_default_hand(), device, precision, ReferenceBackend()).render(shot)


SLAB = np.array([[[-0.3, -0.3, -0.3], [0.3, -0.3, -0.3], [0.0, -0.3, 0.3]]])
LAMPS = (
    Lamp("sun", np.array([3.0, 2, 1]), rotation=np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), angle_rad=0.01),
    Lamp("point", np.array([1.0, 2, 6]), np.array([-0.2, -0.3, 0.3]), radius_m=0.03),
)
LIGHTS = {
    "dome": None,
    "lamps": Light(LAMPS),
    "beside a slab": Light(LAMPS, Sky(np.full((4, 8, 3), 0.3)), SLAB, np.full((1, 3), 0.5)),
}


@pytest.fixture(scope="module", params=LIGHTS)
def shot(request):
    motion = MovingHand(load_default_hand(), (167, 256))
    return replace(motion.shot(motion.frames(3)[1]), light=LIGHTS[request.param])


def test_a_frame_is_the_cpus(shot):
    ours, expected = frame_on(GPU, shot), frame_on("cpu", shot)
    for name in ("rgb", "alpha"):
        difference = np.abs(getattr(ours, name) - getattr(expected, name))
        assert (difference > VALUE * max(1, expected.rgb.max())).mean() < FLIPPED, name
    solid = (ours.alpha > 0.5) & (expected.alpha > 0.5)
    assert solid.sum() > 3000
    assert (np.abs(ours.depth - expected.depth)[solid] > 5e-4).mean() < FLIPPED


def test_half_precision_looks_the_same(shot):
    ours, expected = (frame_on(GPU, shot, precision) for precision in ("bf16", "fp32"))
    assert np.abs(ours.rgb - expected.rgb).mean() < 1e-3
    assert np.abs(ours.alpha - expected.alpha).max() < 0.1


@pytest.mark.parametrize("is_lit", [False, True])
def test_a_training_of_few_steps_gives_the_cpus_weights(painted_capture, lit_capture, is_lit, tmp_path, monkeypatch):
    monkeypatch.setattr("livehand.backend.training.views.choose_backend", lambda device: ReferenceBackend())
    config, reporting = TrainConfig(steps=3, warmup_steps=1), ReportConfig(preview_minutes=0.0)
    surface = surface_of_person(Person(melanin=0.2, folds=1.0, veins_mm=0.2), load_default_hand().sha256)
    write_surface(tmp_path / "surface.npz", surface)
    reference = SurfaceReference(str(tmp_path / "surface.npz"), surface_sha256(surface))
    capture = replace(lit_capture, surface=reference) if is_lit else painted_capture
    task = TrainingSetup(capture, load_default_hand(), LIT if is_lit else BAKED)
    ours, expected = (
        train(task, config, tmp_path / f"{name}.safetensors", ComputeSetup(torch.device(name)), reporting).avatar
        for name in (GPU, "cpu")
    )
    for one, other in zip(ours.superres.parameters(), expected.superres.parameters(), strict=True):
        difference = (one.detach().cpu() - other.detach()).abs()
        assert (difference > VALUE + 0.05 * other.detach().abs()).float().mean() < NOISE


def test_the_benchmark_runs(capsys):
    arguments = ["benchmark", "--device", GPU, "--no-cycles", "--sizes", "167x256", "--paper-sizes", "167x256"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, "--frames", "3", "--budget", "5", "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert bool(result["machine"]["gpu"]) != IS_REHEARSED
    assert result["sizes"]["167x256"]["frame_ms"]["default_bf16"]["median"] > 0
