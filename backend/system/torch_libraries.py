"""torch's compiled libraries, loaded without the interpreter's lock, which importing them holds all the time."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from pathlib import Path

# Blender's window waits for the lock. Reading 400 MB from a slow disk takes ten seconds.
_NAMES = ("libtorch_global_deps", "libtorch")  # in torch's own order; neither needs Python
_SUFFIX = ".dylib" if sys.platform == "darwin" else ".so"


def load_torch_libraries() -> None:
    """Load the libraries, after which `import torch` finds them loaded; other threads go on meanwhile.

    Does nothing where torch is missing, imported already, or installed in another way. On Windows, torch itself lets
    go of the lock.
    """
    if "torch" in sys.modules or os.name != "posix":
        return
    found = importlib.util.find_spec("torch")
    if found is None or found.origin is None:
        return
    load = ctypes.CDLL(None).dlopen  # called by ctypes, which lets go of the lock; `ctypes.CDLL(path)` does not
    load.argtypes, load.restype = (ctypes.c_char_p, ctypes.c_int), ctypes.c_void_p
    for name, flags in zip(_NAMES, (os.RTLD_GLOBAL, os.RTLD_LOCAL), strict=True):
        path = Path(found.origin).parent / "lib" / f"{name}{_SUFFIX}"
        if path.is_file():
            load(os.fsencode(path), flags | os.RTLD_LAZY)
