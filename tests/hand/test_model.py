"""Reading hand models: the built-in one, and files with every fault a user's can have."""

import hashlib

import numpy as np
import pytest
from livehand.backend.hand.model import JOINT_NAMES, PARENTS
from livehand.backend.hand.model_file import (
    DEFAULT_HAND,
    REQUIRED_KEYS,
    builtin_sha256,
    is_builtin_hand,
    load_default_hand,
    load_hand_model,
)
from livehand.backend.records.errors import LiveHandError
from livehand.tools.builtin_hand import TEMPLATE


@pytest.fixture(scope="module")
def arrays():
    with np.load(TEMPLATE) as archive:
        return dict(archive)


@pytest.fixture(scope="session")
def hand(hand_without_arm):
    return hand_without_arm


def write(path, arrays, **changes):
    np.savez(path, **{**arrays, **changes})
    return path


def test_the_built_in_hand(hand):
    assert (hand.name, hand.side) == ("hand_without_arm", "right")
    assert hand.sha256 == hashlib.sha256(TEMPLATE.read_bytes()).hexdigest()
    assert hand.v_template.shape == (1272, 3)
    assert hand.f.shape == (2540, 3)
    assert tuple(hand.parents) == PARENTS
    np.testing.assert_allclose(hand.lbs_weights.sum(1), 1)
    np.testing.assert_allclose(hand.J_regressor.sum(1), 1)
    np.testing.assert_allclose(hand.joints[0], [0.095, 0, 0], atol=1e-5)


def test_the_frame_is_manos(hand):
    """Fingers towards -X, back of the hand +Y, thumb +Z; metres."""
    names = list(JOINT_NAMES)
    assert hand.joints[names.index("middle3"), 0] < hand.joints[0, 0] - 0.12
    assert hand.joints[names.index("thumb3"), 2] > hand.joints[names.index("pinky3"), 2] + 0.05
    assert hand.v_template[:, 0].max() - hand.v_template[:, 0].min() == pytest.approx(0.216, abs=0.001)


def test_a_copy_of_the_file_is_the_same_hand(hand, arrays, tmp_path):
    copy = load_hand_model(write(tmp_path / "copy.npz", arrays))
    for name in ("v_template", "f", "lbs_weights", "J_regressor", "shapedirs", "posedirs", "vt", "ft"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(hand, name))
    assert copy.sha256 != hand.sha256  # not compressed: another file


def test_the_side_comes_from_the_name_unless_it_is_given(arrays, tmp_path):
    assert load_hand_model(write(tmp_path / "a.npz", arrays)).side == "right"
    path = write(tmp_path / "MY_LEFT_hand.npz", arrays)
    assert load_hand_model(path).side == "left"
    assert load_hand_model(path, side="right").side == "right"


def test_twenty_shape_directions_are_cut_to_ten(arrays, tmp_path):
    twenty = np.concatenate([arrays["shapedirs"], np.ones((1272, 3, 10))], -1)
    hand = load_hand_model(write(tmp_path / "twenty.npz", arrays, shapedirs=twenty))
    np.testing.assert_array_equal(hand.shapedirs, arrays["shapedirs"])


def test_for_side_is_itself_or_the_mirror(hand):
    assert hand.for_side("right") is hand
    left = hand.for_side("left")
    assert left.side == "left"
    assert left.sha256 == hand.sha256
    np.testing.assert_array_equal(left.v_template, hand.v_template * [-1, 1, 1])
    np.testing.assert_array_equal(left.f, hand.f[:, ::-1])


@pytest.mark.parametrize("key", REQUIRED_KEYS)
def test_a_missing_array_is_named(arrays, tmp_path, key):
    path = tmp_path / "part.npz"
    np.savez(path, **{name: array for name, array in arrays.items() if name != key})
    with pytest.raises(LiveHandError, match=f"part.npz.*missing: {key}"):
        load_hand_model(path)


WRONG = {
    "v_template": lambda a: a[:, :2],
    "f": lambda a: a[:, :2],
    "weights": lambda a: a[:, :15],
    "J_regressor": lambda a: a.T,
    "kintree_table": lambda a: a[:, :12],
    "shapedirs": lambda a: a[..., :9],
    "posedirs": lambda a: a[..., :133],
    "vt": lambda a: a[:, :1],
    "ft": lambda a: a[:-1],
}


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("key", WRONG)
def test_a_wrong_shape_is_named(arrays, tmp_path, key, side):
    path = write(tmp_path / "bad.npz", arrays, **{key: WRONG[key](arrays[key])})
    name = {"weights": "lbs_weights", "kintree_table": "parents"}.get(key, key)
    with pytest.raises(LiveHandError, match=rf"bad.npz: {name} must be"):
        load_hand_model(path, side)


@pytest.mark.parametrize("key", ["v_template", "f", "weights", "kintree_table", "shapedirs", "vt"])
def test_flat_arrays_are_refused(arrays, tmp_path, key):
    path = write(tmp_path / "bad.npz", arrays, **{key: arrays[key].ravel()})
    with pytest.raises(LiveHandError, match=r"bad.npz"):
        load_hand_model(path)


@pytest.mark.parametrize("key", ["v_template", "f", "weights", "J_regressor", "kintree_table", "shapedirs", "posedirs"])
def test_single_numbers_are_refused(arrays, tmp_path, key):
    path = write(tmp_path / "bad.npz", arrays, **{key: np.float64(1)})
    with pytest.raises(LiveHandError, match=r"bad.npz"):
        load_hand_model(path)


@pytest.mark.parametrize("key", ["v_template", "f", "weights", "J_regressor", "kintree_table", "shapedirs", "posedirs"])
def test_arrays_of_another_axis_are_refused(arrays, tmp_path, key):
    path = write(tmp_path / "bad.npz", arrays, **{key: arrays[key][None]})
    with pytest.raises(LiveHandError, match=r"bad.npz"):
        load_hand_model(path)


@pytest.mark.parametrize("value", [11.0, 1e4, 1e300])
def test_a_vertex_that_would_keep_the_unwrapping_busy_is_refused_at_once(arrays, tmp_path, value):
    vertices = arrays["v_template"].copy()
    vertices[5, 0] = value
    path = write(
        tmp_path / "bad.npz", {key: arrays[key] for key in arrays if key not in ("vt", "ft")}, v_template=vertices
    )
    with pytest.raises(LiveHandError, match=r"within 10 m of the origin, got"):
        load_hand_model(path)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", ["v_template", "weights", "J_regressor", "shapedirs", "posedirs", "vt"])
def test_numbers_must_be_finite(arrays, tmp_path, key, value):
    array = arrays[key].copy()
    array.reshape(-1)[5] = value
    with pytest.raises(LiveHandError, match=r"must be finite"):
        load_hand_model(write(tmp_path / "bad.npz", arrays, **{key: array}))


@pytest.mark.parametrize(("key", "value"), [("f", 1272), ("f", -1), ("ft", 1720), ("ft", -1)])
def test_faces_must_index_what_is_there(arrays, tmp_path, key, value):
    array = arrays[key].astype(np.int64)
    array[100, 1] = value
    with pytest.raises(LiveHandError, match=rf"{key} must index the (1272|1720) rows"):
        load_hand_model(write(tmp_path / "bad.npz", arrays, **{key: array}))


def test_another_tree_is_refused(arrays, tmp_path):
    table = arrays["kintree_table"].copy()
    table[0, 4] = 3
    with pytest.raises(LiveHandError, match="MANO's tree"):
        load_hand_model(write(tmp_path / "bad.npz", arrays, kintree_table=table))


def test_text_for_numbers_is_refused(arrays, tmp_path):
    words = np.full(arrays["weights"].shape, "x")
    with pytest.raises(LiveHandError, match="weights must hold numbers"):
        load_hand_model(write(tmp_path / "bad.npz", arrays, weights=words))


class _Touch:
    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return open, (str(self.marker), "w")


def test_a_pickled_array_in_an_npz_is_refused_and_not_run(arrays, tmp_path):
    marker = tmp_path / "ran"
    path = write(tmp_path / "bad.npz", arrays, weights=np.array([_Touch(marker)], dtype=object))
    with pytest.raises(LiveHandError, match="Python objects, which could run code"):
        load_hand_model(path)
    assert not marker.exists()


def test_what_is_no_npz_is_refused(arrays, tmp_path):
    good = write(tmp_path / "good.npz", arrays).read_bytes()
    faults = {"text": b"v 0 0 0\n", "empty": b"", "cut": good[: len(good) // 2], "noise": good[:4] + good[100:2000]}
    for name, raw in faults.items():
        path = tmp_path / f"{name}.npz"
        path.write_bytes(raw)
        with pytest.raises(LiveHandError, match=f"{name}.npz must be a readable"):
            load_hand_model(path)
    np.save(tmp_path / "single.npy", arrays["v_template"])
    with pytest.raises(LiveHandError, match=r"single.npy must be a readable"):
        load_hand_model(tmp_path / "single.npy")


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    for path in (tmp_path / "none.npz", tmp_path):
        with pytest.raises(LiveHandError, match="no hand model at"):
            load_hand_model(path)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_picture_of_a_hand_with_an_arm_is_framed_by_the_hand(side):
    armed, bare = (load_hand_model(path).for_side(side) for path in (DEFAULT_HAND, TEMPLATE))
    framed = armed.v_template[armed.framed_vertices]
    assert bare.framed_vertices.all()
    assert np.abs(framed[:, 0] - armed.joints[0, 0]).max() == pytest.approx(
        np.abs(bare.v_template[:, 0] - bare.joints[0, 0]).max(), abs=1e-6
    )
    towards_elbow = (framed[:, 0] - armed.joints[0, 0]) * (1 if side == "right" else -1)
    assert 0.02 < towards_elbow.max() < 0.035


def test_the_built_in_hand_is_found_by_its_name_unless_that_is_a_file(arrays, tmp_path, monkeypatch):
    assert load_hand_model(DEFAULT_HAND).sha256 == load_default_hand().sha256 == builtin_sha256()
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "hand.npz", arrays)
    (tmp_path / "hand.npz").rename(DEFAULT_HAND)
    assert not is_builtin_hand(DEFAULT_HAND)
    assert load_hand_model(DEFAULT_HAND).sha256 != builtin_sha256()
