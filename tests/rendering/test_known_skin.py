"""Which avatars show a skin whose fine detail is known, and what a renderer does with it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import avatar_path
from livehand.backend.rendering.skin_detail import detail_of

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def avatar():
    return load_avatar()


def of_person(avatar, capture):
    return detail_of(replace(avatar, provenance={"capture": capture}), CPU)


def test_the_avatars_that_ship_have_their_persons_detail():
    tables = {name: detail_of(load_avatar(avatar_path(name)), CPU)[0].table for name in ("light", "deep")}
    assert not torch.equal(tables["light"], tables["deep"])


@pytest.mark.parametrize(
    "capture",
    [
        None,
        {"made_by": "livehand import", "plan": {"person": {"melanin": 0.0, "folds": 1.0, "veins_mm": 0.2}}},
        {"made_by": "livehand capture", "plan": {"tone": "light"}},
        {
            "made_by": "livehand capture",
            "plan": {"person": {"melanin": 0.0, "folds": 1.0, "veins_mm": 0.2}},
            "look_sha256": None,
        },
        {"made_by": "livehand capture", "plan": {"person": {"melanin": "a", "folds": 1.0, "veins_mm": 0.2}}},
        {"made_by": "livehand capture", "plan": {"person": {"melanin": float("nan"), "folds": 1.0, "veins_mm": 0.2}}},
        {
            "made_by": "livehand capture",
            "plan": {"person": {"melanin": 0.0, "folds": 1.0, "veins_mm": 0.2, "nail_polish": [1, 0, 0]}},
        },
    ],
)
def test_another_skin_has_none(avatar, capture):
    assert of_person(avatar, capture) is None


def test_an_avatar_of_another_hand_has_none(avatar):
    assert detail_of(replace(avatar, hand_sha256="0" * 64), CPU) is None


def test_deeper_folds_are_steeper(avatar):
    young, old = (
        of_person(
            avatar,
            {"made_by": "livehand capture", "plan": {"person": {"melanin": 0.0, "folds": folds, "veins_mm": 0.0}}},
        )[0]
        for folds in (0.7, 1.4)
    )
    slopes = [maps.table[:, 2:6].float().abs().mean().item() for maps in (young, old)]
    assert slopes[1] == pytest.approx(2 * slopes[0], rel=0.1)
    assert np.isfinite(slopes).all()
