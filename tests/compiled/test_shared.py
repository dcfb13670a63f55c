"""Constants that all samples share, and programs in float32."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import pytest
import torch
from torch import Tensor

from mann_torch.compiled import (
    Arguments,
    Job,
    Layout,
    Leaf,
    Program,
    UntraceableError,
    march,
)
from mann_torch.compiled.host.kernels import kernel
from mann_torch.compiled.march.agreement import check_agreement, one_step_job
from mann_torch.compiled.march.engine import Marcher
from mann_torch.compiled.march.layout import Moved

DTYPES = (torch.float64, torch.float32)
#: Rows and columns of a weight matrix: neither is a multiple of what is computed side by side; it
#: is large enough for its gradient to add up in tiles.
N, M, T = 19, 14, 40


def step(given):  # type: ignore[no-untyped-def]
    """A cell with slots: products with W along two dimensions, U only as it is, b added."""
    W, U, b, own = given.constants
    h, slots, count = given.carry
    read = torch.softmax(slots @ (W @ given.segments[0]), 0) @ slots
    new = torch.tanh(W.T @ h + U * (W.T @ read) + b) * own
    return [torch.sigmoid(W @ new) + 0.1 * h, slots + 0.1 * torch.outer(new[:3], h), count + 1]


class Given(NamedTuple):
    """Numbers of a march, (B, ...) but for the weights."""

    weights: list[Tensor]
    own: Tensor
    x: Tensor  # (T, B, M)
    carry: list[Tensor]


def given(batch: int, dtype: torch.dtype) -> Given:
    g = torch.Generator().manual_seed(batch)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=g, dtype=torch.float64).to(dtype)

    weights = [0.5 * normal(N, M), normal(M), normal(M)]
    carry = [normal(batch, N), normal(batch, 3, N), torch.zeros(batch, dtype=torch.int64)]
    return Given(weights, normal(batch, M), normal(T, batch, M), carry)


@functools.cache
def program(dtype: torch.dtype, shared: bool = True) -> Program:
    one = given(1, dtype)
    leaves = (Leaf((N, M), "f", shared), Leaf((M,), "f", shared), Leaf((M,), "f", shared))
    layout = Layout(
        clock=0,
        constants=(*leaves, Leaf((M,))),
        segments=((M,),),
        noise=(),
        carry=(Leaf((N,)), Leaf((3, N)), Leaf((), "i")),
        n_motion=N,
        watched=(0, 1),
    )
    carried = [c[0] for c in one.carry]
    return Program(step, layout, [*one.weights, one.own[0], one.x[0, 0], *carried])


def flat(tensors: list[Tensor], batch: int) -> Tensor:
    return torch.cat([t.reshape(batch, -1) for t in tensors], -1)


def marched(
    n: Given,
    dtype: torch.dtype,
    lanes: int | None = None,
    shared: bool = True,
    limit: float = float("inf"),
    tape: float = 1e9,
) -> tuple[Tensor, list[Tensor], Tensor]:
    """Motion, gradients of a loss to weights, own constants, x and the first carry; stops."""
    batch, made = len(n.own), program(dtype, shared)
    slots = torch.arange(T + 1, dtype=torch.int32)
    job = Job(
        program=made, clock=torch.zeros(T, 0), segment_of=slots[:T], noise=None,
        whole=torch.zeros(batch, 0, dtype=torch.int64), carry_k=n.carry[2].reshape(batch, 1),
        motion_slot=slots, state_slot=torch.full_like(slots, -1), limit=limit,
        tape_memory=tape, wanted=((0, 1, 2, 3), (0,)), lanes=lanes,
    )  # fmt: skip
    free = [w.clone().requires_grad_() for w in n.weights]
    own, x = (t.clone().requires_grad_() for t in (n.own, n.x))
    start = flat(n.carry[:2], batch).requires_grad_()
    row = torch.cat([w.reshape(-1) for w in free])
    if shared:
        found = march(job, own, x, start, row)
    else:
        found = march(job, torch.cat([row.expand(batch, -1), own], -1), x, start)
    g = torch.Generator().manual_seed(3)
    weights = torch.randn(T + 1, 40, N, generator=g, dtype=torch.float64)[:, :batch].to(dtype)
    loss = (found.motion * weights).sum()
    assert torch.equal(found.last_k[:, 0], found.stop.long().clamp(max=T))
    return (
        found.motion.detach(),
        list(torch.autograd.grad(loss, [*free, own, x, start])),
        found.stop,
    )


def eager(n: Given) -> tuple[Tensor, list[Tensor]]:
    """The same in eager torch, float64."""
    double = Given([w.double() for w in n.weights], n.own.double(), n.x.double(), n.carry)
    free = [w.clone().requires_grad_() for w in double.weights]
    own, x = (t.clone().requires_grad_() for t in (double.own, double.x))
    batch = len(own)
    start = flat([c.double() for c in n.carry[:2]], batch).requires_grad_()

    def one(o: Tensor, s: Tensor, h: Tensor, m: Tensor) -> Tensor:
        given = Arguments([], [*free, o], [s], [], [h, m, torch.zeros(())])
        return torch.cat([v.reshape(-1) for v in step(given)[:2]])

    each = torch.func.vmap(one)
    state, motion = start, [start[:, :N]]
    for t in range(T):
        state = each(own, x[t], state[:, :N], state[:, N:].reshape(batch, 3, N))
        motion.append(state[:, :N])
    g = torch.Generator().manual_seed(3)
    weights = torch.randn(T + 1, 40, N, generator=g, dtype=torch.float64)[:, :batch]
    out = torch.stack(motion)
    return out.detach(), list(torch.autograd.grad((out * weights).sum(), [*free, own, x, start]))


def apart(mine: Tensor, other: Tensor) -> float:
    return float((mine - other).abs().max() / other.abs().max())


@pytest.mark.parametrize("dtype", DTYPES)
def test_values_and_gradients_are_those_of_eager_torch(dtype: torch.dtype) -> None:
    n, close = given(21, dtype), {torch.float64: 1e-12, torch.float32: 2e-5}[dtype]
    check_agreement(program(dtype), 1, ((0, 1, 2, 3), (0,)))
    motion, gradients, _ = marched(n, dtype)
    expected = eager(n)
    assert motion.dtype == dtype and all(g.dtype == dtype for g in gradients)
    for mine, other in zip([motion, *gradients], [expected[0], *expected[1]], strict=True):
        assert apart(mine, other) < close


@pytest.mark.slow
def test_shared_constants_are_those_of_every_sample() -> None:
    n = given(13, torch.float64)
    motion, gradients, _ = marched(n, torch.float64)
    again, others, _ = marched(n, torch.float64, shared=False)
    assert apart(motion, again) < 1e-13
    for mine, other in zip(gradients, others, strict=True):
        assert apart(mine, other) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("dtype", DTYPES)
def test_bits_depend_neither_on_lanes_nor_on_checkpoints(dtype: torch.dtype) -> None:
    n = given(21, dtype)  # the last group is filled up
    most = 16 if dtype == torch.float32 else 8
    first = marched(n, dtype, lanes=most)
    for lanes, tape in ((1, 1e9), (most, 1.0), (most, 4e4)):
        again = marched(n, dtype, lanes=lanes, tape=tape)
        assert torch.equal(first[0], again[0])
        for mine, other in zip(first[1], again[1], strict=True):
            assert torch.equal(mine, other)


def test_what_fills_the_last_group_counts_for_nothing() -> None:
    """Its gradients are none even where the last sample's numbers are without bounds."""
    n = given(9, torch.float32)
    alone = marched(n._replace(own=n.own, carry=n.carry), torch.float32, lanes=16)
    n.x[:, -1] = 1e30
    found = marched(n, torch.float32, lanes=16, limit=1e3)
    assert torch.equal(found[0][:, :8], alone[0][:, :8])
    assert all(bool(g.isfinite().all()) for g in found[1])


@pytest.mark.slow
@pytest.mark.parametrize("dtype", DTYPES)
def test_a_sample_that_ends_leaves_the_sums_of_its_mates(dtype: torch.dtype) -> None:
    n = given(17, dtype)
    n.x[20, 4] = torch.nan  # sample 4 ends there
    lanes = 16 if dtype == torch.float32 else 8
    _, gradients, stop = marched(n, dtype, lanes=lanes, limit=1e3)
    assert stop.tolist() == [20 if i == 4 else T for i in range(17)]
    assert all(bool(g.isfinite().all()) for g in gradients)
    one = marched(n, dtype, lanes=1, limit=1e3)
    for mine, other in zip(gradients, one[1], strict=True):
        assert torch.equal(mine, other)


def test_the_gradient_of_a_large_matrix_adds_up_in_tiles() -> None:
    text = program(torch.float64).backward(1, (0, 1, 2, 3), (0,)).text
    assert "tile_4_2_4(sums" in text and "tile_3_2_4(sums" in text


def test_a_launch_of_one_step_needs_no_packing() -> None:
    made = program(torch.float32)
    job, *tensors = one_step_job(made, 1)
    marcher = Marcher(job, Moved(*tensors), backward=False)
    text = made.forward(1)
    heap = marcher._heap(text.heap)
    table = marcher._table(heap, text.heap, (None,))
    once = kernel(text.text, 1).single(table)
    given_ = [t.clone() for t in tensors]
    for _ in range(3):
        once()
        carry = one_step_job(made, 1)[0]
        found = march(dataclasses.replace(carry, carry_k=marcher_k(marcher) - 1), *given_)
        given_[2] = found.last_f
        assert torch.equal(marcher.last()[0], found.last_f)


def marcher_k(marcher: Marcher) -> Tensor:
    return marcher.last()[1]


MIXED = {
    "a step of float32 and float64 together": lambda x: x,
    "computes in torch.float64, not in float32": lambda x: x.double() * 0.1,
    "zeros_like": lambda x: x + torch.zeros_like(x, dtype=torch.float64),
    "a float64 operand among float32 ones": lambda x: (
        x * (x > torch.tensor([0.1, 0.2], dtype=torch.float64))
    ),
    "beyond 32 bits": lambda x: x * torch.tensor(2**40),
}


@pytest.mark.parametrize("told", MIXED)
def test_another_precision_is_refused(told: str) -> None:
    x = torch.tensor([0.3, 0.4])
    layout = Layout(0, (Leaf(()),), (), (), (Leaf((2,)),), 0, ())
    c = torch.tensor(1.0, dtype=torch.float64 if "together" in told else torch.float32)
    with pytest.raises(UntraceableError, match=told):
        Program(lambda given: [MIXED[told](given.carry[0]) * given.constants[0]], layout, [c, x])
