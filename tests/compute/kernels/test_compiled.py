"""Kernels: their arithmetic is single, and their cache serves several names of the package."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.compute.kernels.compiled import compiled, compiled_loosely


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
raster = importlib.import_module(name + ".backend.compute.kernels.raster")
records = importlib.import_module(name + ".backend.compute.kernels.records")
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
