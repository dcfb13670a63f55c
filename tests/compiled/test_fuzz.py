"""The compiler against eager torch: random graphs and their gradients, 1e-12."""

from __future__ import annotations

import pytest
import torch

from .marching import Together, check_together
from .random_graphs import inputs, random_graph

#: Graphs to a kernel, and kernels: 500 graphs in all.
GRAPHS, KERNELS, QUICK = 50, 10, 3


@pytest.mark.parametrize(
    "number", [n if n < QUICK else pytest.param(n, marks=pytest.mark.slow) for n in range(KERNELS)]
)
def test_random_graphs_and_their_gradients(number: int) -> None:
    given = inputs(GRAPHS, seed=number)
    graphs = dict(random_graph(GRAPHS * number + i, given.sample(i)) for i in range(GRAPHS))
    assert len(graphs) >= GRAPHS - 3  # now and then two are alike
    worst = check_together(graphs, given)
    print(f"{len(graphs)} graphs: largest difference {worst:.1e}")


def test_bits_depend_neither_on_the_batch_nor_on_threads() -> None:
    given = inputs(11, seed=77)
    graphs = [random_graph(9000 + i, given.sample(0))[1] for i in range(20)]
    together = Together(graphs, given)
    rows = together.run(given)
    for number in range(11):
        alone = together.run(given.rows([number]))
        for mine, other in zip(alone, rows, strict=True):
            assert torch.equal(mine[0].nan_to_num(7.0), other[number].nan_to_num(7.0))
