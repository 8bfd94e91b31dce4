"""The rasterised shell: one rasterisation per frame, which all sampling starts from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from ..geometry.mesh import PosedMesh, Topology
from ..nerf.rays import HandInView, project
from ..nerf.sampler import SamplerConfig
from .kernels.compiled import in_parallel
from .kernels.raster import nearest_depth, surface_layers
from .kernels.rays import find_live
from .kernels.surface import FACE_COLUMNS, face_shapes, gather_shapes


class ShellCrossings(NamedTuple):
    """The rasterised shell over P pixels of a view.

    Attributes:
        depth: [P, L] crossings of the inflated mesh, nearest first, m.
        face: [P, L] their faces; a back face f as -1 - f.
        crossings: [P] how many there are.
        inner: [P] depth of the deflated mesh's first front, m; infinite where there is none.
    """

    depth: np.ndarray
    face: np.ndarray
    crossings: np.ndarray
    inner: np.ndarray


def rasterise_shell(hand: HandInView, config: SamplerConfig) -> ShellCrossings:
    """The layers of the inflated mesh and the first front of the deflated one."""
    mesh, topology, view = hand
    shell = config.shell_m * mesh.scale * mesh.normals
    outer = [values.numpy() for values in project(view, mesh.vertices + shell)]
    inner = [values.numpy() for values in project(view, mesh.vertices - shell)]
    faces, (width, height) = topology.faces.numpy(), view.size_px
    pixels = width * height
    layers = ShellCrossings(
        depth=np.empty((pixels, config.max_layers), np.float32),
        face=np.empty((pixels, config.max_layers), np.int32),
        crossings=np.zeros(pixels, np.int32),
        inner=np.full(pixels, np.inf, np.float32),
    )

    def rasterise_rows(first: int, last: int) -> None:
        surface_layers((*outer, faces), width, first, last, layers.depth, layers.face, layers.crossings)
        nearest_depth((*inner, faces), width, first, last, False, layers.inner)

    in_parallel(rasterise_rows, height, torch.get_num_threads())
    return layers


def live_pixels(layers: ShellCrossings) -> np.ndarray:
    """[R] the pixels whose rays have anything to sample."""
    is_live = np.zeros(len(layers.crossings), np.bool_)
    in_parallel(
        lambda first, last: find_live(tuple(layers), first, last, is_live), len(is_live), torch.get_num_threads()
    )
    return is_live.nonzero()[0]


def surface_arrays(mesh: PosedMesh, topology: Topology) -> tuple[np.ndarray, ...]:
    """What laying samples on the posed surface needs: shapes, those around, neighbours, faces, vertices, normals."""
    vertices, faces, neighbours = mesh.vertices.numpy(), topology.faces.numpy(), topology.neighbours.numpy()
    shapes = np.empty((len(faces), FACE_COLUMNS), np.float32)
    around = np.empty((len(faces), FACE_COLUMNS, neighbours.shape[1] - 1), np.float32)
    threads = torch.get_num_threads()
    in_parallel(lambda first, last: face_shapes(vertices, faces, first, last, shapes), len(faces), threads)
    in_parallel(lambda first, last: gather_shapes(shapes, neighbours, first, last, around), len(faces), threads)
    return shapes, around, neighbours, faces, vertices, mesh.normals.numpy()
