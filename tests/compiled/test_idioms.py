"""Ways of writing a step in several lines: tables, buffers, loops, long chains."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from .marching import Function, Inputs, Together, check_together

Sample = dict[str, Tensor]


def inputs() -> Inputs:
    g = torch.Generator().manual_seed(3)

    def normal(*shape: int) -> Tensor:
        return torch.randn(4, *shape, generator=g, dtype=torch.float64)

    times = torch.linspace(0.0, 1.0, 6, dtype=torch.float64).expand(4, 6).clone()
    return Inputs(
        {"a": normal(4), "m": normal(3, 3), "points": normal(6, 2), "times": times},
        {
            "x": normal(4),
            "y": normal(30),
            "t": torch.tensor([0.13, 0.5, 0.77, 0.9], dtype=torch.float64),
            "k": torch.tensor([0, 2, 3, 1]),
            "row": torch.tensor([[0, 1], [3, 3], [2, 0], [1, 2]]),
        },
    )


IDIOMS: dict[str, Function] = {}


def idiom(function: Function) -> Function:
    IDIOMS[function.__name__] = function
    return function


@idiom
def waypoints_between_which_a_reference_moves(s: Sample) -> Tensor:
    after = torch.searchsorted(s["times"], s["t"]).clamp(1, 5)
    start, end = s["times"][after - 1], s["times"][after]
    share = (s["t"] - start) / (end - start)
    return torch.lerp(s["points"][after - 1], s["points"][after], share)


@idiom
def rows_chosen_by_numbers(s: Sample) -> Tensor:
    k = s["k"]
    return s["points"][k] + s["points"][-1 - k, 1] + s["points"].T[..., k] + s["a"][None, k]


@idiom
def values_put_at_a_number(s: Sample) -> Tensor:
    x, points = s["x"].clone(), s["points"].clone()
    x[s["k"]] = s["t"]
    points[s["k"], 1:] = s["a"][:1]
    points[1:, 0][s["k"]] = 3.0
    points[:, s["k"] % 2] += 1.0
    return x.sum() * points


@idiom
def rows_put_by_numbers(s: Sample) -> Tensor:
    found = s["points"].clone()
    found[s["row"][:1]] = 0.5 * s["a"][:2]
    found.index_add_(0, s["row"], s["m"][:2, :2])
    return found.scatter(1, s["row"][None] % 2, 7.0)


@idiom
def slices_assigned(s: Sample) -> Tensor:
    x = s["x"].clone()
    x[1:] = x[:-1] * 2
    x[::2] += s["a"][:2]
    x[0], x[-1] = x[1].clone() * x[2].clone(), s["t"]
    m = s["m"].clone()
    m[0] = s["a"][1:]
    m[:, 1] *= 0.5
    m.diagonal().add_(1.0)
    m[1:, 1:] = m[:2, :2].clone()
    return m.sum(0).sum() * x


@idiom
def masks_assigned(s: Sample) -> Tensor:
    x = s["x"].clone()
    x[x > 0.3] = 0.3
    x[s["a"] < 0] = float("-inf")
    return x.softmax(0).masked_fill(s["a"] > 1, 0.0) + x.clamp(min=-1.0)


@idiom
def a_buffer_that_shifts(s: Sample) -> Tensor:
    shifted = torch.cat([s["x"][1:], s["t"][None]])
    rolled = torch.roll(shifted, 1)
    rolled[0] = s["t"].square()
    return torch.stack([shifted, rolled]) @ torch.arange(4.0, dtype=torch.float64)


@idiom
def packed_and_unpacked_through_runge_kutta(s: Sample) -> Tensor:
    state = torch.cat([s["x"], s["a"]])

    def rate(state: Tensor) -> Tensor:
        q, qd = state.split(4)
        return torch.cat([qd, -q.sin() - 0.1 * qd])

    h = 0.05
    for _ in range(5):
        k1 = rate(state)
        k2 = rate(state + h / 2 * k1)
        k3 = rate(state + h / 2 * k2)
        k4 = rate(state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


@idiom
def a_matrix_filled_entry_by_entry(s: Sample) -> Tensor:
    q = s["x"]
    M = torch.zeros(2, 2, dtype=torch.float64)
    M[0, 0] = 2.0 + q[0].cos()
    M[0, 1] = M[1, 0] = 0.5 * q[1].cos()
    M[1, 1] = 1.5
    return torch.linalg.solve(M, torch.stack([q[2], q[3]]))


@idiom
def a_filter_in_a_loop(s: Sample) -> Tensor:
    states, gains = list(s["x"].unbind()), torch.tensor([0.5, 0.25, 0.125, 1.0])
    for i in range(4):
        states[i] = states[i] + gains[i] * (s["a"][i] - states[i - 1])
    return torch.stack(states)


@idiom
def float32_numbers_made_on_the_way(s: Sample) -> Tensor:
    third = torch.tensor(1.0) / 3
    return s["x"] * third + torch.linspace(0, 1, 4) * 0.1 + torch.tensor([0.1, 0.2, 0.3, 0.4])


@idiom
def nothing_at_all(s: Sample) -> Tensor:
    none = s["x"][:0]
    return torch.cat([none, s["x"], none.sin()]) + none.sum() + (s["m"][:, :0] @ s["m"][:0]).sum()


@idiom
def equal_numbers_share_a_gradient(s: Sample) -> Tensor:
    x = s["x"] * torch.tensor([1.0, 0.0, 0.0, 1.0], dtype=torch.float64)
    twin = torch.stack([s["t"], s["t"], s["t"] * 1.0])
    found = [torch.maximum(x, -x), x.abs(), x.clamp(min=0.0), x.relu(), torch.minimum(x, 0.0 * x)]
    found += [
        twin.amax(),
        twin.max(),
        twin.max(0).values,
        twin.sort().values,
        twin.norm(),
        x.norm(),
    ]
    return torch.cat([f.reshape(-1) for f in found])


def test_idioms() -> None:
    check_together(IDIOMS, inputs())


def long(count: int, step: Callable[[Tensor, Sample], Tensor], name: str = "x") -> Function:
    def function(s: Sample) -> Tensor:
        x = s[name]
        for _ in range(count):
            x = step(x, s)
        return x

    return function


@pytest.mark.slow
def test_long_chains_stay_within_pythons_stack() -> None:
    def packed(s: Sample) -> Tensor:
        x = torch.cat([s["x"], s["a"]])
        for _ in range(300):
            x = 0.99 * x + 0.01
        return x[:4] - x[4:]

    chains = {
        "sums": long(400, lambda x, s: x * 0.999 + 0.01 * s["a"]),
        "shifts": long(100, lambda x, s: torch.cat([x[1:], x[:1] * 0.9])),
        "packed": packed,
    }
    check_together(chains, inputs(), tolerance=1e-11)


def pair(
    start: Callable[[Sample], tuple[Tensor, Tensor]], end: Callable[[Tensor], Tensor]
) -> Function:
    """Each value is read by the next two: written out, the text would double and double."""

    def function(s: Sample) -> Tensor:
        a, b = start(s)
        for _ in range(40):
            a, b = (a * b).tanh() + 0.5 * a, a
        return end(a)

    return function


PAIRS = {
    "plain": pair(lambda s: (s["a"], s["x"]), lambda a: a),
    "scalar": pair(lambda s: (s["t"], s["a"][0]), lambda a: a),
    "packed": pair(
        lambda s: (torch.cat([s["a"], s["x"]]), torch.cat([s["x"], s["a"].sin()])),
        lambda a: a[:4] * a[4:],
    ),
    "reshaped": pair(
        lambda s: (s["a"].reshape(2, 2) * 1.0, s["x"].reshape(2, 2).mT), lambda a: a.reshape(4)
    ),
}


@pytest.mark.slow
def test_text_grows_with_the_number_of_operations() -> None:
    given = inputs()
    check_together(PAIRS, given)
    empty = len(Together([lambda s: s["x"]], given).program.forward(1).text)
    for function in PAIRS.values():
        assert len(Together([function], given).program.forward(1).text) - empty < 40 * 400


def test_an_expression_read_at_many_places_is_not_written_at_each() -> None:
    def spread(s: Sample) -> Tensor:
        x = long(30, lambda x, s: (0.9 * x).sin() + 0.1, "y")(s)
        return torch.stack([x[i] * x[29 - i] for i in range(30)])

    given = inputs()
    check_together({"spread": spread}, given)
    assert Together([spread], given).program.forward(1).text.count("sin_(") < 100


@pytest.mark.parametrize("threads", [1, 2])
def test_idioms_alone_and_together_have_the_same_bits(threads: int) -> None:
    torch.set_num_threads(threads)
    given = inputs().rows([i % 4 for i in range(11)])
    together = Together(list(IDIOMS.values()), given)
    weights = torch.ones(11, sum(r.numel() for r in together.results), dtype=torch.float64)
    rows = together.run(given, weights)
    for number in (0, 3, 10):
        alone = together.run(given.rows([number]), weights[:1])
        for mine, other in zip(alone, rows, strict=True):
            assert torch.equal(mine[0].nan_to_num(7.0), other[number].nan_to_num(7.0))
