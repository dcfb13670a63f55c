"""Two processes of torch's DistributedDataParallel learn what one learns."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel

import mann_torch as mt
from tests.conftest import randn


def model() -> nn.Module:
    torch.manual_seed(0)
    layers = mt.MemoryLayers(3, 6, n_slots=4, return_state=False, dtype=torch.float64)
    return nn.Sequential(layers, nn.Linear(6, 1, dtype=torch.float64))


def worker(rank: int, folder: str) -> None:
    torch.set_num_threads(1)
    where = f"file://{folder}/meeting"
    torch.distributed.init_process_group("gloo", init_method=where, rank=rank, world_size=2)
    found = DistributedDataParallel(model())
    found(randn(5, 4, 3)[:, 2 * rank : 2 * rank + 2]).square().mean().backward()
    if rank == 0:
        slopes = {n: p.grad for n, p in found.module.named_parameters() if p.grad is not None}
        torch.save(slopes, Path(folder) / "slopes.pt")
        del slopes
    del found  # before its group: torn down after it, a process may wait for ever
    torch.distributed.destroy_process_group()


@pytest.mark.slow
def test_gradients_are_those_of_the_whole_batch() -> None:
    with tempfile.TemporaryDirectory() as folder:
        torch.multiprocessing.spawn(worker, (folder,), nprocs=2)
        slopes = torch.load(Path(folder) / "slopes.pt")
    alone = model()
    alone(randn(5, 4, 3)).square().mean().backward()
    expected = {n: p.grad for n, p in alone.named_parameters() if p.grad is not None}
    assert slopes.keys() == expected.keys() and len(slopes) > 10
    for name, slope in expected.items():
        torch.testing.assert_close(slopes[name], slope, rtol=0, atol=1e-13)
