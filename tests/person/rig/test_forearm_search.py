"""Forearms are turned to where the pictures show skin beyond the wrists."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.person.rig.calibration import RigView
from livehand.backend.person.rig.forearm_search import with_forearms
from livehand.backend.person.rig.view_masks import ARM
from livehand.backend.records.shot import HandPose

pytestmark = pytest.mark.slow

BENT = {"right": (0.0, 0.3, -0.8), "left": (0.0, 0.0, 0.7)}
MOST_OFF_RAD = 0.12  # the finest step tried is 0.05, along two axes; wrists are half a hand's width from arms' edges


@pytest.fixture(scope="module")
def bent_rig(made_rig):
    """The made rig's hands with bent wrists."""
    poses = {
        side: HandPose(pose.theta, pose.beta, pose.transl, side, np.array(BENT[side]))
        for side, pose in made_rig.poses.items()
    }
    return replace(made_rig, poses=poses)


def straight(rig):
    parameters = rig.hands.parameters(rig.poses)
    return parameters._replace(forearm=torch.zeros_like(parameters.forearm))


def test_bent_wrists_are_found_in_views_that_count(bent_rig):
    views = bent_rig.views()
    views[2] = replace(views[2], rgb=np.roll(views[2].rgb, 150, 1))
    found = with_forearms(straight(bent_rig), bent_rig.hands, views, bent_rig.cameras, held_out=[2])
    for row, side in enumerate(bent_rig.hands.sides):
        assert found.forearm[row].numpy() == pytest.approx(BENT[side], abs=MOST_OFF_RAD)
    assert torch.equal(found.theta, straight(bent_rig).theta)


def test_arms_in_sleeves_go_on_straight(bent_rig):
    cloth = [
        RigView(
            view.name, np.where((labels == ARM)[..., None], (40, 60, 70), view.rgb).astype(np.uint8), view.camera, 0
        )
        for view, labels in zip(bent_rig.views(), bent_rig.labels(), strict=True)
    ]
    found = with_forearms(straight(bent_rig), bent_rig.hands, cloth, bent_rig.cameras)
    assert not found.forearm.any()
