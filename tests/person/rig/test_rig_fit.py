"""The whole road from finds to hands, cameras and labels."""

import numpy as np
import pytest
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.person.rig.rig_cameras import turned
from livehand.backend.person.rig.rig_fit import fitted_hands
from livehand.backend.records.errors import LiveHandError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def whole_road(made_rig):
    """Views whose cameras 1 and 6 were moved since they were calibrated, 6 held out, fitted from noisy finds."""
    views, lines = made_rig.views(), []
    for row, turn in ((1, (0.0, 0.025, 0.0, 0.0)), (6, (0.02, 0.0, 0.0, 0.0))):
        view = views[row]
        views[row] = view.__class__(view.name, view.rgb, turned(view.camera, np.array(turn)), view.camera_index)
    return views, fitted_hands(views, made_rig.found(1.5), made_rig.model, [6], lines.append), lines


@pytest.mark.nightly
def test_the_whole_road_brings_hands_and_cameras_back(made_rig, whole_road):
    _, found, lines = whole_road
    for side, pose in found.poses.items():
        off = np.linalg.norm(
            posed_vertices(made_rig.model, pose) - posed_vertices(made_rig.model, made_rig.poses[side]), axis=1
        )
        assert off[made_rig.model.arm_weights < 0.5].mean() < 3e-3
    assert set(found.off_px) == {1, 6}
    assert found.off_px[1] == pytest.approx(0.025 * 520, abs=2.5)
    for side in made_rig.poses:
        stages = [np.mean(found.overlaps[name][side]) for name in ("landmarks", "outlines", "offsets")]
        assert stages[0] < stages[1]
        assert stages[1] > 0.95
        assert stages[2] > stages[1] - 0.005
    assert any("cameras off by more than 5 px: {2: " in line for line in lines)


@pytest.mark.nightly
def test_the_whole_road_s_labels_are_the_truth_s(made_rig, whole_road):
    _, found, _ = whole_road
    agree = [(one == truth).mean() for one, truth in zip(found.labels, made_rig.labels(), strict=True)]
    assert min(agree) > 0.97


def test_too_few_views_that_are_not_held_out_are_refused(made_rig):
    with pytest.raises(LiveHandError, match="not held out; hold out fewer"):
        fitted_hands(made_rig.views(), made_rig.found(), made_rig.model, range(6))
