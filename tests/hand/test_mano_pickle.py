"""MANO-shaped pickles with made-up numbers, written as Python 2 would, and pickles that mean harm."""

import os
import pickle
import struct
import sys

import numpy as np
import pytest
from livehand.backend.hand.mano_pickle import _ALLOWED, read_mano_pickle
from livehand.backend.hand.model import PARENTS
from livehand.backend.hand.model_file import load_default_hand, load_hand_model, load_hands_mean
from livehand.backend.records.errors import LiveHandError

GLOBALS = {
    "reconstruct": "numpy.core.multiarray _reconstruct",
    "ndarray": "numpy ndarray",
    "dtype": "numpy dtype",
    "csc": "scipy.sparse.csc csc_matrix",
    "select": "chumpy.reordering Select",
    "ch": "chumpy.ch Ch",
    "set": "__builtin__ set",
}


class Global:
    """A name in a pickle; `Global("os system")`."""

    def __init__(self, name):
        self.name = name


class Call:
    """`function(*arguments)`, then its state; written with REDUCE, or NEWOBJ as for Python 2's new-style classes."""

    def __init__(self, function, arguments, state=None, opcode=pickle.REDUCE):
        self.function, self.arguments, self.state, self.opcode = Global(function), arguments, state, opcode


class Python2Pickler(pickle._Pickler):
    """Protocol 2 with Python-2 strings, and any global, without importing what it names."""

    def save(self, value, save_persistent_id=True):
        if isinstance(value, Global):
            self.write(pickle.GLOBAL + value.name.replace(" ", "\n").encode() + b"\n")
        elif isinstance(value, Call):
            self._save_call(value)
        elif isinstance(value, np.ndarray):
            self._save_call(array_call(value))
        elif isinstance(value, str | bytes):
            raw = value.encode() if isinstance(value, str) else value
            self.write(pickle.BINSTRING + struct.pack("<i", len(raw)) + raw)
        else:
            super().save(value, save_persistent_id)

    def _save_call(self, call):
        self.save(call.function)
        self.save(tuple(call.arguments))
        self.write(call.opcode)
        if call.state is not None:
            self.save(call.state)
            self.write(pickle.BUILD)


def array_call(array, raw=None, code=None):
    is_fortran = array.ndim > 1 and array.flags.f_contiguous
    code = code or array.dtype.str[1:]
    dtype = Call(GLOBALS["dtype"], (code, 0, 1), (3, array.dtype.str[0], None, None, None, -1, -1, 0))
    raw = array.tobytes("A") if raw is None else raw
    return Call(
        GLOBALS["reconstruct"], (Global(GLOBALS["ndarray"]), (0,), "b"), (1, array.shape, dtype, is_fortran, raw)
    )


def newobj(name, state):
    return Call(name, (), state, pickle.NEWOBJ)


def sparse_columns(dense):
    columns = [np.flatnonzero(column) for column in dense.T]
    state = {
        "_shape": dense.shape,
        "maxprint": 50,
        "indices": np.concatenate(columns).astype(np.int32),
        "indptr": np.cumsum([0, *map(len, columns)]).astype(np.int32),
        "data": np.concatenate([dense[rows, j] for j, rows in enumerate(columns)]),
    }
    return newobj(GLOBALS["csc"], state)


def shape_selection(shapedirs, extra):
    leaf = np.concatenate([shapedirs, extra], -1)
    chosen = np.arange(leaf.size).reshape(leaf.shape)[..., : shapedirs.shape[-1]].ravel()
    variable = newobj(GLOBALS["ch"], {"x": leaf, "_dirty_vars": Call(GLOBALS["set"], (["x"],)), "_itr": None})
    return newobj(GLOBALS["select"], {"a": variable, "idxs": chosen, "preferred_shape": shapedirs.shape})


def mano_content(side="right"):
    """MANO's keys and types around the built-in hand, made irregular; left as MPI ships it: shapedirs not mirrored."""
    model = load_default_hand()
    hand = model.for_side(side)
    rng = np.random.default_rng(0)
    parents = np.array([PARENTS, range(16)])
    parents[0, 0] = 4294967295
    return {
        "bs_type": "lrotmin",
        "bs_style": "lbs",
        "v_template": hand.v_template,
        "f": hand.f.astype(np.uint32),
        "weights": np.asfortranarray(hand.lbs_weights),
        "posedirs": hand.posedirs,
        "shapedirs": shape_selection(model.shapedirs, rng.normal(size=(*model.shapedirs.shape[:2], 10))),
        "J_regressor": sparse_columns(hand.J_regressor),
        "J": hand.joints,
        "kintree_table": parents,
        "hands_mean": rng.normal(size=45).astype(">f4"),
    }


def write(path, content):
    with path.open("wb") as file:
        Python2Pickler(file, 2).dump(content)
    return path


@pytest.fixture(scope="module")
def right_file(tmp_path_factory):
    return write(tmp_path_factory.mktemp("mano") / "MANO_RIGHT.pkl", mano_content())


def test_exactly_seven_globals_are_allowed():
    assert {name.replace(" ", ".") for name in GLOBALS.values()} == set(_ALLOWED)


def test_arrays_are_read_unchanged(hand, right_file):
    arrays = read_mano_pickle(right_file)
    np.testing.assert_array_equal(arrays["v_template"], hand.v_template)
    np.testing.assert_array_equal(arrays["weights"], hand.lbs_weights)
    np.testing.assert_array_equal(arrays["shapedirs"], hand.shapedirs)
    np.testing.assert_allclose(arrays["J_regressor"], hand.J_regressor, atol=0)
    np.testing.assert_array_equal(arrays["f"], hand.f)
    assert arrays["f"].dtype == np.uint32
    np.testing.assert_array_equal(arrays["hands_mean"], mano_content()["hands_mean"])
    assert arrays["hands_mean"].dtype == np.dtype(">f4")
    assert all(type(array) is np.ndarray and array.flags.writeable for array in arrays.values())
    assert "bs_type" not in arrays


@pytest.mark.slow
def test_a_right_pickle_loads_as_the_hand_it_was_made_of(hand, right_file):
    loaded = load_hand_model(right_file)
    assert loaded.side == "right"
    for name in ("v_template", "f", "lbs_weights", "parents", "shapedirs", "posedirs", "J_regressor"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(hand, name), err_msg=name)


@pytest.mark.slow
def test_a_left_pickle_loads_as_the_exact_mirror_of_the_right_one(right_file, tmp_path):
    left = load_hand_model(write(tmp_path / "MANO_LEFT.pkl", mano_content("left")))
    mirrored = load_hand_model(right_file).for_side("left")
    assert left.side == "left"
    for name in ("v_template", "f", "lbs_weights", "parents", "shapedirs", "posedirs", "J_regressor"):
        np.testing.assert_array_equal(getattr(left, name), getattr(mirrored, name), err_msg=name)


@pytest.mark.slow
def test_a_corrected_left_file_is_read_unchanged(hand, tmp_path):
    content = mano_content("left")
    content["shapedirs"] = hand.for_side("left").shapedirs
    left = load_hand_model(write(tmp_path / "left.pkl", content))
    np.testing.assert_array_equal(left.shapedirs, hand.for_side("left").shapedirs)


def test_neither_scipy_nor_chumpy_is_needed(right_file, monkeypatch):
    for name in ("scipy", "scipy.sparse", "chumpy"):
        monkeypatch.setitem(sys.modules, name, None)  # an import of it now fails
    assert read_mano_pickle(right_file)["J_regressor"].shape == (16, len(load_default_hand().v_template))


class _Shell:
    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.system, (f"touch {self.marker}",)


def test_os_system_is_refused_by_name_and_not_run(tmp_path):
    marker = tmp_path / "ran"
    bad = tmp_path / "bad.pkl"
    bad.write_bytes(pickle.dumps({"v_template": _Shell(marker)}, protocol=2))
    with pytest.raises(LiveHandError, match=r"bad.pkl.*(posix|nt)\.system"):
        read_mano_pickle(bad)
    assert not marker.exists()


@pytest.mark.parametrize(
    "name",
    [
        "os system",
        "posix system",
        "builtins eval",
        "__builtin__ eval",
        "__builtin__ getattr",
        "builtins set",
        "numpy load",
        "numpy fromfile",
        "numpy.core.multiarray fromfile",
        "numpy.core.multiarray scalar",
        "numpy.testing._private.utils runstring",
        "numpy.f2py compile",
        "_codecs encode",
        "copy_reg _reconstructor",
        "chumpy.ch_ops add",
        "scipy.sparse.csc csc_matrix.__init__",
        "livehand.backend.hand.mano_pickle _require",
    ],
)
def test_every_other_global_is_refused_by_name(name, tmp_path):
    bad = write(tmp_path / "bad.pkl", {"v_template": Call(name, ("1",))})
    with pytest.raises(LiveHandError, match=name.replace(" ", r"\.")):
        read_mano_pickle(bad)


def test_stack_global_and_inst_are_refused_too(tmp_path):
    bad = tmp_path / "bad.pkl"
    for raw in (b"\x80\x04\x8c\x02os\x8c\x06system\x93.", b"(S'true'\nios\nsystem\n.", b"cos\nsystem\n(S'true'\ntR."):
        bad.write_bytes(raw)
        with pytest.raises(LiveHandError, match=r"os\.system"):
            read_mano_pickle(bad)


def with_function(call, function, arguments):
    return Call(function, arguments, call.state)


# What a file puts where an array is due, and what the error says of it.
HARMFUL_ARRAYS = {
    "object dtype": (array_call(np.zeros(1), code="O8"), "plain numbers, got dtype 'O8'"),
    "object dtype by letter": (array_call(np.zeros(1), code="O"), "plain numbers, got dtype 'O'"),
    "record with objects": (array_call(np.zeros(1), code="f8,O"), "plain numbers, got dtype 'f8,O'"),
    "list of objects for data": (array_call(np.zeros(1), raw=["x"]), "raw numbers"),
    "too little data": (array_call(np.zeros(5), raw=b"12345678"), "reshape"),
    "ndarray called": (Call(GLOBALS["ndarray"], ((2, 2),)), "cannot be read"),
    "ndarray made": (Call(GLOBALS["ndarray"], (), None, pickle.NEWOBJ), "not called"),
    "array of a foreign class": (
        with_function(array_call(np.zeros(1)), GLOBALS["reconstruct"], (Global(GLOBALS["set"]), (0,), "b")),
        "numpy's own class",
    ),
    "array without state": (Call(GLOBALS["reconstruct"], (Global(GLOBALS["ndarray"]), (0,), "b")), "cannot be read"),
    "text": ("1 2 3", "must be an array, got str"),
    "a set": (Call(GLOBALS["set"], ([],)), "must be an array, got set"),
    "selection of a set": (
        newobj(GLOBALS["select"], {"a": Call(GLOBALS["set"], ([],)), "idxs": np.arange(2), "preferred_shape": (2,)}),
        "must be of a Ch",
    ),
    "selection out of range": (
        newobj(
            GLOBALS["select"],
            {"a": newobj(GLOBALS["ch"], {"x": np.zeros(2)}), "idxs": np.arange(9), "preferred_shape": (9,)},
        ),
        "out of bounds",
    ),
    "leaf without value": (newobj(GLOBALS["ch"], {"y": np.zeros(2)}), "must have 'x'"),
    "sparse with lengths that do not fit": (
        newobj(
            GLOBALS["csc"], {"_shape": (2, 2), "indptr": np.arange(3), "indices": np.arange(1), "data": np.zeros(1)}
        ),
        "must hold 2 columns",
    ),
    "sparse outside its shape": (
        newobj(
            GLOBALS["csc"],
            {"_shape": (2, 1), "indptr": np.array([0, 1]), "indices": np.array([7]), "data": np.zeros(1)},
        ),
        "out of bounds",
    ),
}


@pytest.mark.parametrize("kind", HARMFUL_ARRAYS)
def test_arrays_that_are_not_plain_numbers_are_refused(kind, tmp_path):
    content, message = HARMFUL_ARRAYS[kind]
    bad = write(tmp_path / "bad.pkl", {"v_template": content})
    with pytest.raises(LiveHandError, match=rf"bad\.pkl.*{message}"):
        read_mano_pickle(bad)


def test_a_pickled_object_array_is_refused_before_its_objects_exist(tmp_path):
    marker = tmp_path / "ran"
    bad = tmp_path / "bad.pkl"
    bad.write_bytes(pickle.dumps({"v_template": np.array([_Shell(marker)], dtype=object)}, protocol=2))
    with pytest.raises(LiveHandError):
        read_mano_pickle(bad)
    assert not marker.exists()


def test_state_cannot_be_set_on_the_stand_ins_themselves(tmp_path):
    """BUILD on a class instead of an instance would change it for every later file."""
    for name in GLOBALS.values():
        before = dict(vars(_ALLOWED[name.replace(" ", ".")]))
        bad = tmp_path / "bad.pkl"
        with bad.open("wb") as file:
            pickler = Python2Pickler(file, 2)
            file.write(b"\x80\x02")
            pickler.save(Global(name))
            pickler.save((None, {"numpy": 1, "state": 2}))
            file.write(pickle.BUILD + pickle.STOP)
        with pytest.raises(LiveHandError):
            read_mano_pickle(bad)
        assert dict(vars(_ALLOWED[name.replace(" ", ".")])) == before


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.9999])
def test_a_truncated_file_is_refused(right_file, tmp_path, share):
    raw = right_file.read_bytes()
    cut = tmp_path / "cut.pkl"
    cut.write_bytes(raw[: int(len(raw) * share)])
    with pytest.raises(LiveHandError, match="download it again"):
        read_mano_pickle(cut)


def test_what_is_no_dictionary_or_lacks_arrays_is_refused(tmp_path):
    with pytest.raises(LiveHandError, match="dictionary"):
        read_mano_pickle(write(tmp_path / "list.pkl", [1, 2]))
    content = mano_content()
    del content["posedirs"]
    with pytest.raises(LiveHandError, match="missing: posedirs"):
        load_hand_model(write(tmp_path / "part.pkl", content))
    with pytest.raises(LiveHandError, match="no hand model at"):
        load_hand_model(tmp_path / "none.pkl")


def test_the_mean_pose_is_read_and_must_be_one(tmp_path):
    content, path = mano_content(), tmp_path / "MANO_RIGHT.pkl"
    write(path, content)
    np.testing.assert_array_equal(load_hands_mean(path), content["hands_mean"].reshape(15, 3))
    for spoilt in (content["hands_mean"][:44], content["hands_mean"] * np.float32(np.nan)):
        write(path, {**content, "hands_mean": spoilt})
        with pytest.raises(LiveHandError, match="hands_mean must be 45 finite numbers"):
            load_hands_mean(path)
