"""Canaries for torch's internals, which may move between versions, and numbers that choose."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor, nn
from torch.fx import GraphModule
from torch.fx.proxy import TracerBase

from mann_torch.compiled import UntraceableError, transformed, with_tensors
from mann_torch.compiled.trace.choosing import Choosing
from mann_torch.compiled.trace.tracing import told, trace, trace_vjp

#: Versions of torch, first and first not, that the compiler has been tried with.
TRIED = (2, 10), (2, 14)


def number(*shape: int) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def operations(made: GraphModule) -> list[str]:
    return [
        str(node.target).removeprefix("aten.")
        for node in made.graph.nodes
        if node.op == "call_function"
    ]


def changing(made: GraphModule) -> list[str]:
    """Operations that change an operand."""
    schemas = [getattr(node.target, "_schema", None) for node in made.graph.nodes]
    return [str(schema) for schema in schemas if schema is not None and schema.is_mutable]


def test_torch_is_of_a_version_that_was_tried() -> None:
    version = tuple(int(part) for part in torch.__version__.split(".")[:2])
    assert TRIED[0] <= version < TRIED[1], "a new torch: see whether tests/compiled still pass"


def test_a_function_traces_to_the_operations_known_of_old() -> None:
    def function(given: Sequence[Tensor]) -> list[Tensor]:
        A, x = given
        return [torch.tanh(A @ x) + torch.where(x > 0, x, 2.0).sum()]

    assert operations(trace(function, [number(3, 3), number(3)])) == [
        "mul.Tensor", "sum.dim_IntList", "tanh.default", "gt.Scalar", "scalar_tensor.default",
        "where.self", "sum.dim_IntList", "add.Tensor", "clone.default",
    ]  # fmt: skip


def test_a_derivative_is_traced_with_it() -> None:
    def function(given: Sequence[Tensor]) -> list[Tensor]:
        return [torch.sin(given[0]) * given[1]]

    made = trace_vjp(function, [number(3), number(3)], wanted=[1, 0], outputs=[0])
    assert len([n for n in made.graph.nodes if n.op == "placeholder"]) == 3
    x, y, seed = number(3), number(3) + 1, number(3) + 2
    to_y, to_x = made(x, y, seed)
    assert torch.allclose(to_y, seed * x.sin()) and torch.allclose(to_x, seed * y * x.cos())


def test_nothing_is_changed_in_place_in_a_trace() -> None:
    def function(given: Sequence[Tensor]) -> list[Tensor]:
        x, A = given[0].clone(), given[1]
        x.add_(1.0)
        x[0] = 2.0 * x[1]
        x[1:].mul_(3.0)
        similar = torch.nn.functional.cosine_similarity(x, A[0], dim=0)
        return [x @ A + torch.isclose(x, x).double() + similar]  # in-place inside torch

    examples = [number(3), number(3, 3)]
    made = trace(function, examples)
    assert not changing(made)
    assert torch.allclose(made(*examples)[0], function(examples)[0])


def test_random_numbers_elsewhere_are_left_as_they_were() -> None:
    torch.manual_seed(7)
    expected = torch.rand(2)
    torch.manual_seed(7)
    trace(lambda given: [given[0] + torch.rand(3).double()], [number(3)])
    assert torch.equal(torch.rand(2), expected)


def test_a_module_gets_its_tensors_back() -> None:
    module = nn.Sequential(nn.Linear(2, 2), nn.LayerNorm(2)).double()
    before = dict(module.named_parameters())
    replaced = {name: torch.zeros_like(p) for name, p in before.items()}
    with pytest.raises(ZeroDivisionError), with_tensors(module, replaced):
        assert not module(number(2)).any()
        raise ZeroDivisionError
    after = dict(module.named_parameters())
    assert all(after[name] is p for name, p in before.items())


def test_transforms_of_torch_are_noticed() -> None:
    assert not transformed()
    seen: list[bool] = []

    def function(x: Tensor) -> Tensor:
        seen.append(transformed())
        return x.sum()

    torch.func.grad(function)(number(3))
    torch.func.vmap(function)(number(2, 3))
    torch.func.jvp(function, (number(3),), (number(3),))
    assert seen == [True] * 3 and not transformed()


def test_torchs_own_way_of_noting_lines_is_put_back() -> None:
    kept = TracerBase._filter_traceback_frames

    def refused() -> None:
        raise UntraceableError("no")

    with pytest.raises(UntraceableError):
        told(refused)
    assert TracerBase._filter_traceback_frames is kept


CHOICES: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "row": lambda x, k: x[k],
    "last": lambda x, k: x[..., k % 3],
    "middle": lambda x, k: x[:, k],
    "negative": lambda x, k: x[-1 - k % 2],
    "two": lambda x, k: x[k % 2, k],
    "beside a slice": lambda x, k: x[1:, None, k, ::2],
    "beside a number": lambda x, k: x[0, k, 1],
    "beside a list": lambda x, k: x[k % 2, [0, 2, 1]],
    "beside a mask": lambda x, k: x[k % 2, torch.tensor([True, False, True, True])],
    "int32": lambda x, k: x[k.int() % 2],
}


@pytest.mark.parametrize("name", CHOICES)
def test_an_integer_tensor_chooses_as_its_number_would(name: str) -> None:
    x = number(2, 4, 3)
    for k in (0, 1):
        expected = CHOICES[name](x, torch.tensor(k))
        with Choosing():
            assert torch.equal(CHOICES[name](x, torch.tensor(k)), expected)


PLACES: dict[str, Callable[[Tensor, Tensor, Tensor], None]] = {
    "row": lambda x, k, y: x.__setitem__(k, 7.0),
    "tensor": lambda x, k, y: x.__setitem__(k, y),
    "broadcast": lambda x, k, y: x.__setitem__(k, y[0]),
    "too many ones": lambda x, k, y: x.__setitem__(k, y[None]),
    "last": lambda x, k, y: x.__setitem__((..., k), y[:, 0]),
    "negative": lambda x, k, y: x.__setitem__((slice(None), -1 - k), y[0]),
    "two": lambda x, k, y: x.__setitem__((k, k + 1), y[0]),
    "beside a slice": lambda x, k, y: x.__setitem__((slice(1, None), k, slice(0, 3, 2)), y[1, :2]),
    "beside a number": lambda x, k, y: x.__setitem__((0, k, 1), 1),
    "beside nothing": lambda x, k, y: x.__setitem__((None, k), y),
}


@pytest.mark.parametrize("name", PLACES)
def test_an_integer_tensor_places_as_its_number_would(name: str) -> None:
    for k in (0, 1):
        expected, found = number(2, 4, 3), number(2, 4, 3)
        PLACES[name](expected, torch.tensor(k), number(4, 3))
        with Choosing():
            PLACES[name](found, torch.tensor(k), number(4, 3))
        assert torch.equal(found, expected)


def test_one_hot_vectors_need_no_largest_number() -> None:
    k = torch.tensor([[0, 2], [1, 1]])
    with Choosing():
        assert torch.equal(
            torch.nn.functional.one_hot(k, 4), torch.nn.functional.one_hot(k, num_classes=4)
        )
        assert torch.nn.functional.one_hot(k).shape == (2, 2, 3)
