"""Work shared among threads: every index once, whatever the numbers, and no error is lost."""

import os
import subprocess
import sys
from pathlib import Path
from threading import Barrier, Event, Lock, Thread, current_thread, get_ident

import numpy as np
import pytest
from livehand.backend.fast.kernels.compiled import compiled, compiled_loosely, in_parallel


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
@pytest.mark.parametrize("count", [0, 1, 2, 7, 8, 15, 16, 17, 23, 24, 25, 63, 64, 65, 100, 1000, 1001])
def test_every_index_is_covered_once(count, threads):
    covered, lock = np.zeros(count + 1, np.int64), Lock()

    def run(first, last):
        assert 0 <= first <= last <= count
        with lock:
            covered[first:last] += 1

    in_parallel(run, count, threads)
    assert (covered[:count] == 1).all()
    assert covered[count] == 0


def test_many_indices_are_run_on_two_threads_and_few_on_this_one():
    seen, both = set(), Barrier(2)

    def run(first, last):
        if get_ident() not in seen:
            seen.add(get_ident())
            both.wait(10)

    in_parallel(run, 1000, 2)
    assert len(seen) == 2
    assert get_ident() in seen
    for count, threads in ((1000, 1), (5, 2)):
        here = []
        in_parallel(lambda first, last, here=here: here.append((get_ident(), first, last)), count, threads)
        assert here == [(get_ident(), 0, count)]


def test_nobody_waits_for_a_thread_that_does_not_come():
    """As where another program holds its core: here, another call has it."""
    started, over, here = Event(), Event(), []

    def hold(first, last):
        if current_thread().name.startswith("livehand"):
            started.set()
            over.wait(60)
        started.wait(60)

    other = Thread(target=in_parallel, args=(hold, 1000, 2))
    other.start()
    assert started.wait(60)
    work = Thread(target=in_parallel, args=(lambda first, last: here.append(get_ident()), 1000, 2))
    work.start()
    work.join(20)
    is_done = not work.is_alive()
    over.set()
    assert is_done
    assert set(here) == {work.ident}
    other.join()


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_in_one_part_comes_out(threads):
    def run(first, last):
        if first <= 500 < last:
            raise KeyError("from a part")

    with pytest.raises(KeyError, match="from a part"):
        in_parallel(run, 1000, threads)
    done = []
    in_parallel(lambda first, last: done.append(last - first), 1000, threads)  # and the threads work on
    assert sum(done) == 1000


def test_work_within_work_of_another_number_of_threads_comes_to_an_end():
    """Blender renders a frame beside the viewport's: calls overlap."""
    sums = []
    in_parallel(lambda a, b: in_parallel(lambda first, last: sums.append(last - first), 100, 3), 1000, 2)
    assert sum(sums) == 100 * 16


def test_single_precision_stays_single():
    """One float64 constant would make a whole kernel double, and slow."""
    third = np.float32(1) / np.float32(3)
    for decorate in (compiled, compiled_loosely):
        double = decorate(_plus_third)
        assert double(np.float32(1)) == np.float32(1) + third
        assert double.signatures[0][0].name == "float32"


def _plus_third(x):
    return x + np.float32(1) / np.float32(3)


UNDER_A_NAME = """
import sys, importlib, importlib.util
name, root = sys.argv[1:]
spec = importlib.util.spec_from_file_location(name, root + "/__init__.py", submodule_search_locations=[root])
sys.modules[name] = package = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
import numpy as np
raster = importlib.import_module(name + ".backend.fast.kernels.raster")
records = importlib.import_module(name + ".backend.fast.kernels.records")
corners = np.array([[0, 0], [8, 0], [0, 8]], np.float32)
mesh = records.ProjectedMesh(corners, np.ones(3, np.float32), np.array([[0, 1, 2]]))
nearest = np.full(64, np.inf, np.float32)
raster.nearest_depth(mesh, 8, 0, 8, True, nearest)
print(int(np.isfinite(nearest).sum()))
"""


@pytest.mark.slow
def test_the_cache_of_one_package_name_does_not_break_another(tmp_path):
    """An extension and a pip package import the same files under two names, and named tuples are cached by name."""
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    root = str(Path(__file__).parents[3])
    for name in ("first_name", "second_name", "first_name"):
        command = [sys.executable, "-c", UNDER_A_NAME, name, root]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=120)
        assert done.stdout.strip() == "36", done.stderr
