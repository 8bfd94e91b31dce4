"""A shape that the ten numbers cannot say comes back from outlines and from targets of vertices."""

import numpy as np
import pytest
import torch
from livehand.backend.person.rig.landmark_pose import landmark_targets
from livehand.backend.person.rig.outline_fit import RigFit, ViewOutlines
from livehand.backend.person.rig.rig_cameras import RigCameras
from livehand.backend.person.rig.shape_offsets import VertexTargets, fitted_offsets

pytestmark = pytest.mark.slow

SCALE = 0.85


@pytest.fixture(scope="module")
def swollen(made_rig):
    """Hands whose fingers are 2.5 mm thicker; their true fit and vertices."""
    hands = made_rig.hands
    fit = RigFit(hands.parameters(made_rig.poses), torch.zeros(8, 4))
    fingers = made_rig.model.lbs_weights[:, 1:].sum(1)
    offset_m = torch.as_tensor(np.stack([0.0025 * fingers] * 2), dtype=torch.float32)
    normals = hands.posed_normals(fit.parameters)
    return fit, offset_m, hands.show(fit.parameters, normals * offset_m[..., None])


def targets_of(rig):
    return landmark_targets(rig.found(), RigCameras.of(rig.cameras))


@pytest.mark.nightly
def test_outlines_give_offsets_and_the_forearm_has_none(made_rig, swollen):
    fit, _, shown = swollen
    labels = made_rig.labels(shown.all_vertices.double().numpy())
    outlines = ViewOutlines.of(labels, [SCALE] * 8)
    found = fitted_offsets(fit, made_rig.hands, made_rig.cameras, outlines, targets_of(made_rig))
    fingers, arm = made_rig.model.lbs_weights[:, 1:].sum(1) > 0.99, made_rig.model.arm_weights > 0.9
    offset_mm = 1000 * found.offset_m.numpy()
    assert offset_mm[:, fingers].mean() == pytest.approx(2.5, abs=1.0)
    assert np.abs(offset_mm[:, arm]).max() < 0.6


def test_no_difference_gives_no_offsets(made_rig, swollen):
    fit, _, _ = swollen
    outlines = ViewOutlines.of(made_rig.labels(), [SCALE] * 8)
    found = fitted_offsets(fit, made_rig.hands, made_rig.cameras, outlines, targets_of(made_rig), rounds=1)
    assert 1000 * found.offset_m.pow(2).mean().sqrt() < 0.4


def test_targets_of_visible_vertices_move_them(made_rig, swollen):
    fit, _, _ = swollen
    hands, stacked = made_rig.hands, RigCameras.of(made_rig.cameras)
    palm = torch.as_tensor(np.flatnonzero(made_rig.model.lbs_weights[:, 0] * (1 - made_rig.model.arm_weights) > 0.95))
    truth = torch.zeros(2, len(hands.arm))
    truth[0, palm] = 0.003
    shown = hands.show(fit.parameters, hands.posed_normals(fit.parameters) * truth[..., None])

    class Targets:
        def targets(self, state):
            rows = range(8)
            px = [stacked.project(shown.vertices[0, palm], row, torch.zeros(4))[0] for row in rows]
            sure = torch.ones(len(palm))
            return [VertexTargets(0, row, palm, at, sure, SCALE) for row, at in zip(rows, px, strict=True)]

        def surface(self, state):
            return None

    outlines = ViewOutlines.of([np.zeros((320, 400), np.uint8)] * 8, [SCALE] * 8)  # none
    found = fitted_offsets(fit, hands, made_rig.cameras, outlines, targets_of(made_rig), (), Targets())
    assert 1000 * found.offset_m[0, palm].mean() == pytest.approx(3.0, abs=1.2)
    assert 1000 * found.offset_m[1].abs().max() < 0.1
