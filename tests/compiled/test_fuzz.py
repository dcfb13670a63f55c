"""The compiler against eager torch: random graphs and their gradients, 1e-12; float32: 3e-5."""

from __future__ import annotations

import pytest
import torch

from .marching import Together, check_together
from .random_graphs import inputs, random_graph

#: Graphs to a kernel, and kernels: 500 graphs in all.
GRAPHS, KERNELS, QUICK = 50, 10, 1


@pytest.mark.parametrize(
    "number", [n if n < QUICK else pytest.param(n, marks=pytest.mark.slow) for n in range(KERNELS)]
)
def test_random_graphs_and_their_gradients(number: int) -> None:
    given = inputs(GRAPHS, seed=number)
    graphs = dict(random_graph(GRAPHS * number + i, given.sample(i)) for i in range(GRAPHS))
    assert len(graphs) >= GRAPHS - 3  # now and then two are alike
    worst = check_together(graphs, given)
    print(f"{len(graphs)} graphs: largest difference {worst:.1e}")


@pytest.mark.parametrize(
    ("number", "count"),
    [(100, 3), *(pytest.param(n, GRAPHS, marks=pytest.mark.slow) for n in range(101, 107))],
)
def test_random_graphs_in_float32(number: int, count: int) -> None:
    given = inputs(count, seed=number).single()
    graphs = dict(random_graph(GRAPHS * number + i, given.sample(i)) for i in range(count))
    worst = check_together(graphs, given, 3e-5)
    print(f"{len(graphs)} graphs: largest difference {worst:.1e}")


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2])
def test_bits_depend_neither_on_the_batch_nor_on_threads(threads: int) -> None:
    torch.set_num_threads(threads)
    given = inputs(11, seed=77)
    graphs = [random_graph(9000 + i, given.sample(0))[1] for i in range(12)]
    together = Together(graphs, given)
    weights = torch.ones(11, sum(r.numel() for r in together.results), dtype=torch.float64)
    rows = together.run(given, weights)  # in lanes
    for number in range(11):
        alone = together.run(given.rows([number]), weights[:1])  # in one
        for mine, other in zip(alone, rows, strict=True):
            assert torch.equal(mine[0].nan_to_num(7.0), other[number].nan_to_num(7.0))
