"""Where training runs: its device, and several processes at once (`torchrun`).

Each process renders its share of a step's views, and the gradients are summed. All processes hold the same weights and
do the same steps; only the first one writes files.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

import torch
import torch.distributed as dist
from jaxtyping import Float
from torch import Tensor, nn

from ..compute.precision import Precision
from ..render.device import torch_device

Item = TypeVar("Item")


@dataclass(frozen=True)
class Processes:
    """This process among all.

    Attributes:
        rank: of this process.
        count: number of processes.
    """

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:
        """Whether this process writes the files."""
        return self.rank == 0

    def share(self, items: Sequence[Item]) -> Sequence[Item]:
        """Select this process's part of a step's work."""
        return items[self.rank :: self.count]

    def sum(self, values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Sum over the processes."""
        if self.count > 1:
            dist.all_reduce(values)
        return values

    def sum_gradients(self, parameters: Iterable[nn.Parameter]) -> None:
        """Sum the gradients over the processes; a parameter that no process used keeps none."""
        if self.count == 1:
            return
        used = list(parameters)
        gradients = [torch.zeros_like(p) if p.grad is None else p.grad for p in used]
        has_gradient = gradients[0].new_tensor([p.grad is not None for p in used])
        flat = self.sum(torch.cat([has_gradient, *(gradient.flatten() for gradient in gradients)]))
        counts, *summed = flat.split([len(used), *(p.numel() for p in used)])
        for parameter, gradient, count in zip(used, summed, counts.tolist(), strict=True):
            parameter.grad = gradient.view_as(parameter) if count else None

    def from_first(self, value: float, device: torch.device) -> float:
        """Return the first process's value."""
        if self.count == 1:
            return value
        shared = torch.tensor([value], dtype=torch.float64, device=device)
        dist.broadcast(shared, 0)
        return float(shared)


@dataclass(frozen=True)
class ComputeSetup:
    """Where and how exactly training computes.

    Attributes:
        device: of this process.
        precision: bf16 uses autocast; weights, losses and gradients of weights stay fp32.
        processes: this process among all.
    """

    device: torch.device
    precision: Precision = "fp32"
    processes: Processes = field(default_factory=Processes)


@contextmanager
def joined_processes(device: torch.device) -> Iterator[Processes]:
    """Join the processes started by `torchrun`, or return this process alone."""
    if not (dist.is_available() and dist.is_torchelastic_launched()):
        yield Processes()
        return
    dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield Processes(dist.get_rank(), dist.get_world_size())
    finally:
        dist.destroy_process_group()


def process_device(name: str) -> torch.device:
    """Return the device of this name (`torch_device`); under `torchrun` each process of a machine uses its own GPU.

    Raises:
        LiveHandError: CUDA is requested but not available.
    """
    device = torch_device(name)
    if device.type == "cuda" and "LOCAL_RANK" in os.environ:
        device = torch.device("cuda", int(os.environ["LOCAL_RANK"]))
        torch.cuda.set_device(device)
    return device
