"""The plan of a lit capture: the same hands and views as in the dome, each in a light of its own."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.capture import index_document
from livehand.backend.capture.plan import CapturePlan

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("relieved_once")]

PLAN = CapturePlan(poses=39, cameras=14, cameras_per_pose=3, size_px=(24, 32), eval_views=4, lights="varied")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("lit_plan")


@pytest.fixture(scope="module")
def lit(hand, folder):
    return PLAN.make(folder, hand, {})


def image_of(view):
    return view.pose_index, view.camera_index, view.split


def test_hands_and_training_views_are_those_of_the_dome(lit, hand, folder):
    dome = replace(PLAN, lights="dome").make(folder, hand, {})
    for one, other in zip(lit.poses, dome.poses, strict=True):
        np.testing.assert_array_equal(one.theta, other.theta)
    images = {image_of(view): view.camera for view in lit.of_split("train")}
    assert sorted(images) == sorted(image_of(view) for view in dome.of_split("train"))
    for view in dome.of_split("train"):
        np.testing.assert_array_equal(images[image_of(view)].cam2world, view.camera.cam2world)
    assert "lights" not in replace(PLAN, lights="dome").facts()
    assert PLAN.facts()["lights"] == "varied"


def test_every_image_has_a_light_of_its_own(lit):
    assert Counter(view.light for view in lit.views) == Counter(range(len(lit.lights)))
    skies = {lit.lights[view.light].light.sky.radiance.tobytes() for view in lit.views if view.file.endswith("_g0.exr")}
    kinds = Counter(lit.lights[view.light].kind for view in lit.views if view.file.endswith("_g0.exr"))
    assert len(skies) == len({image_of(view) for view in lit.views}) - kinds["dome"] + 1


def test_the_groups_of_an_image_follow_one_another(lit):
    assert [view.file for view in lit.views] == sorted(view.file for view in lit.views)
    seen = []
    for view in lit.views:
        if not seen or seen[-1] != image_of(view):
            seen.append(image_of(view))
        assert view.is_linear
    assert len(seen) == len(set(seen))
    sizes = Counter(image_of(view) for view in lit.of_split("train"))
    assert set(sizes.values()) == {1, 2, 3}


def test_kinds_of_held_out_light_come_in_equal_parts(lit):
    def kinds(split):
        return Counter(lit.lights[view.light].kind for view in lit.of_split(split))

    assert kinds("test") == Counter(soft=2, key=2, rim=2, block=2, dome=2)
    assert kinds("novel_light") == Counter(soft=1, key=1, rim=1, block=1)
    trained = {image_of(view)[:2] for view in lit.of_split("train")}
    assert {image_of(view)[:2] for view in lit.of_split("novel_light")} <= trained


def test_every_eighth_training_image_has_an_occluder(lit):
    images = {image_of(view): lit.lights[view.light] for view in lit.of_split("train")}
    with_one = [light for light in images.values() if len(light.light.occluders)]
    free_domes = sum(light.kind == "dome" for light in images.values())
    assert len(images) / 8 - free_domes <= len(with_one) <= len(images) / 8 + 1
    assert all(len(light.light.occluders) == 12 for light in with_one)


def test_the_first_poses_are_lit_as_in_the_whole_plan(lit, hand, folder):
    some = replace(PLAN, first_poses=7).make(folder, hand, {})
    whole = [view for view in lit.views if view.pose_index < 7]
    assert [view.file for view in some.views] == [view.file for view in whole]
    for one, other in zip(some.views, whole, strict=True):
        a, b = some.lights[one.light], lit.lights[other.light]
        assert a.kind == b.kind
        assert [lamp.rgb.tolist() for lamp in a.light.lamps] == [lamp.rgb.tolist() for lamp in b.light.lamps]
    assert {view.light for view in some.views} == set(range(len(some.lights)))


def test_equal_plans_give_equal_lights_and_another_seed_others(lit, hand, folder):
    assert index_document(PLAN.make(folder, hand, {})) == index_document(lit)
    other = replace(PLAN, seed=1).make(folder, hand, {})
    assert index_document(other) != index_document(lit)
