"""Programs: what they leave out, what they refuse, and text that a GPU's compiler takes."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import torch
from torch import Tensor

from mann_torch.compiled import Layout, Leaf, Program, UntraceableError
from mann_torch.compiled.march.agreement import check_agreement
from mann_torch.compiled.march.program import Step


def program(step: Step, *constants: Tensor, carry: Tensor) -> Program:
    """A step of constants and one carried tensor."""
    layout = Layout(
        clock=0,
        constants=tuple(Leaf(tuple(c.shape)) for c in constants),
        segments=(),
        noise=(),
        carry=(Leaf(tuple(carry.shape)),),
        n_motion=1,
        watched=(0,),
    )
    return Program(step, layout, [*constants, carry])


def number(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_constants_nobody_reads_are_left_out() -> None:
    def step(given):  # type: ignore[no-untyped-def]
        return [given.carry[0] * given.constants[1] + 0.0 * given.carry[0].detach()]

    made = program(step, number(1.0, 2.0), number(3.0, 4.0), number(5.0), carry=number(1.0, 2.0))
    assert made.used == (1,) and made.layout.size("constant") == 2
    check_agreement(made, 1, ((0,), ()))


def test_a_step_that_changes_what_it_carries_is_refused() -> None:
    def grows(given):  # type: ignore[no-untyped-def]
        return [torch.cat([given.carry[0], given.carry[0]])]

    with pytest.raises(UntraceableError, match=r"f\(1,\) into f\(2,\)"):
        program(grows, carry=number(1.0))


def test_a_derivative_that_differs_is_refused_and_remembered() -> None:
    asked: list[float] = []

    def step(given):  # type: ignore[no-untyped-def]
        asked.append(random.random())
        x = given.carry[0]
        return [x * x + asked[-1] * (x - x.detach())]  # a slope that Python draws

    made = program(step, carry=number(0.5))
    check_agreement(made, 1)
    with pytest.raises(UntraceableError, match="gradient 0 of the compiled step differs"):
        check_agreement(made, 1, ((), ()))
    count = len(asked)
    with pytest.raises(UntraceableError, match="gradient 0 of the compiled step differs"):
        check_agreement(made, 1, ((), ()))
    assert len(asked) == count  # it is not tried again


def test_a_marchs_text_compiles_for_a_gpu(tmp_path: Path) -> None:
    import warp as wp

    from mann_torch.compiled.host.kernels import missing
    from mann_torch.compiled.host.warp_kernel import declare

    def step(given):  # type: ignore[no-untyped-def]
        x = given.carry[0]
        A = torch.outer(x, x) + torch.eye(3, dtype=x.dtype)
        chosen = torch.where(x > given.constants[0], torch.sin(x), torch.exp(-x.square()))
        return [x + 0.1 * torch.linalg.solve(A, chosen) * x.sort().values]

    assert missing() is None
    made = program(step, number(0.3), carry=number(0.1, 0.5, 0.9))
    for name, text in (("to", made.forward(1)), ("fro", made.backward(1, (0,), ()))):
        folder = tmp_path / name
        folder.mkdir()
        kernel = declare(f"gpu_{name}", text.text, {"fuse_fp": False})
        wp.compile_aot_module(kernel.module, module_dir=folder, arch=80, use_ptx=True)
        assert list(folder.glob("*.ptx"))
