"""Functions of one sample marched for one compiled step, and the same in eager torch.

Many functions share one kernel: each is a leaf of the carry. Every function's gradient stands by
itself, as each gets a sample of its own whose cotangent is zero for all others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from mann_torch.compiled import Arguments, Job, Layout, Leaf, Program, march
from mann_torch.compiled.march.agreement import row_of

#: A function of named tensors of one sample.
Function = Callable[[dict[str, Tensor]], Tensor]
KINDS = {torch.float64: "f", torch.float32: "f", torch.int64: "i", torch.bool: "b"}


@dataclass(frozen=True)
class Inputs:
    """Tensors by name with a first dimension for samples: some constant, some carried."""

    constants: dict[str, Tensor]
    carried: dict[str, Tensor]

    @property
    def all(self) -> dict[str, Tensor]:
        """Constants, then what is carried."""
        return {**self.constants, **self.carried}

    def sample(self, number: int) -> dict[str, Tensor]:
        """One sample's tensors."""
        return {name: value[number] for name, value in self.all.items()}

    def single(self) -> Inputs:
        """The same in float32."""
        found = (
            {n: v.float() if v.is_floating_point() else v for n, v in part.items()}
            for part in (self.constants, self.carried)
        )
        return Inputs(*found)

    def rows(self, samples: Sequence[int]) -> Inputs:
        """Some of the samples."""
        chosen = list(samples)
        return Inputs(
            {n: v[chosen] for n, v in self.constants.items()},
            {n: v[chosen] for n, v in self.carried.items()},
        )


class Together:
    """Functions compiled into one step."""

    def __init__(self, functions: Sequence[Function], inputs: Inputs) -> None:
        self.functions = functions
        example = inputs.sample(0)
        with torch.no_grad():
            self.results = [f(example) for f in functions]
        carried = [*self.results, *(example[n] for n in inputs.carried)]
        names, first = list(inputs.all), len(inputs.constants)
        count = len(functions)

        def step(given: Arguments) -> list[Tensor]:
            kept = given.carry[count:]
            named = dict(zip(names, [*given.constants, *kept], strict=True))
            return [*(f(named) for f in functions), *kept]

        layout = Layout(
            clock=0,
            constants=tuple(_leaf(example[n]) for n in names[:first]),
            segments=(),
            noise=(),
            carry=tuple(_leaf(t) for t in carried),
            n_motion=0,
            watched=(),
        )
        examples = [*(example[n] for n in names[:first]), *map(torch.zeros_like, self.results)]
        examples += [example[n] for n in names[first:]]
        self.program = Program(step, layout, examples)
        self.wanted = tuple(
            i for i, leaf in enumerate(self.program.layout.constants) if leaf.kind == "f"
        )

    def run(self, inputs: Inputs, weights: Tensor | None = None) -> tuple[Tensor, ...]:
        """Floating numbers and others after one step, (B, F) and (B, K).

        With `weights` (B, F), also the gradients to the floating constants that are used and to
        the floating carry.
        """
        layout, dtype = self.program.layout, self.program.layout.real.dtype
        names = list(inputs.constants)
        constants = [inputs.constants[names[i]] for i in self.program.used]
        batch = len(next(iter(inputs.all.values())))
        zeros = [t.new_zeros(batch, *t.shape) for t in self.results]
        carry = [*zeros, *inputs.carried.values()]
        slot = torch.tensor([-1, 0], dtype=torch.int32)
        job = Job(
            program=self.program,
            clock=torch.zeros(1, 0, dtype=dtype),
            segment_of=torch.zeros(1, dtype=torch.int32),
            noise=None,
            whole=_rows(constants, False, batch),
            carry_k=_rows(carry, False, batch),
            motion_slot=slot,
            state_slot=slot,
            limit=float("inf"),
            tape_memory=1e9,
            wanted=(self.wanted, ()),
        )
        rows = [_rows(x, True, batch).to(dtype) for x in (constants, carry)]
        segments = torch.zeros(1, batch, 0, dtype=dtype)
        if weights is None:
            marched = march(job, rows[0], segments, rows[1])
            return marched.last_f, marched.last_k
        given = [row.requires_grad_() for row in rows]
        marched = march(job, given[0], segments, given[1])
        padded = torch.zeros(batch, layout.size("f"), dtype=dtype)
        padded[:, : weights.shape[1]] = weights
        (marched.state_f[0] * padded).sum().backward()
        return marched.last_f, marched.last_k, *(row.grad for row in given)

    def split(self, rows: tuple[Tensor, Tensor]) -> list[Tensor]:
        """Each function's result, one row a sample, from what `run` returns."""
        found, layout = [], self.program.layout
        for result, (array, offset) in zip(self.results, layout.carry_places, strict=False):
            row = rows[array != "f"][:, offset : offset + result.numel()]
            value = row.reshape(len(row), *result.shape)
            found.append(value != 0 if result.dtype == torch.bool else value)
        return found

    def gradients(self, found: Sequence[Tensor], inputs: Inputs) -> dict[str, Tensor]:
        """Gradients by input's name, from the last two results of `run`."""
        layout, program = self.program.layout, self.program
        names = list(inputs.constants)
        gradients = {n: torch.zeros_like(v) for n, v in inputs.all.items() if v.is_floating_point()}
        for i, number in enumerate(program.used):
            name, (array, offset) = names[number], layout.constant_places[i]
            if array == "constant":
                shape = inputs.constants[name].shape
                size = shape[1:].numel()
                gradients[name] = found[0][:, offset : offset + size].reshape(shape)
        places = layout.carry_places[len(self.results) :]
        for (name, value), (array, offset) in zip(inputs.carried.items(), places, strict=True):
            if array == "f":
                size = value.shape[1:].numel()
                gradients[name] = found[1][:, offset : offset + size].reshape(value.shape)
        return gradients


def eager_gradients(
    function: Function, sample: dict[str, Tensor], weights: Tensor
) -> tuple[Tensor, dict[str, Tensor]]:
    """Value and vector-Jacobian product in eager torch."""
    given = {n: v.detach().clone().requires_grad_(v.is_floating_point()) for n, v in sample.items()}
    value = function(given)
    moving = {n: v for n, v in given.items() if v.requires_grad}
    if not value.requires_grad:
        return value.detach(), {n: torch.zeros_like(v) for n, v in moving.items()}
    found = torch.autograd.grad(value, list(moving.values()), weights, allow_unused=True)
    return value.detach(), {
        n: torch.zeros_like(v) if g is None else g
        for (n, v), g in zip(moving.items(), found, strict=True)
    }


def difference(mine: Tensor, other: Tensor) -> float:
    """Largest difference relative to the largest finite entry; inf where NaN or inf differ."""
    if not other.is_floating_point():
        return 0.0 if torch.equal(mine.to(other.dtype), other) else float("inf")
    if not other.numel():
        return 0.0
    same = (mine == other) | (mine.isnan() & other.isnan())
    if not bool((same | (mine.isfinite() & other.isfinite())).all()):
        return float("inf")
    finite = other[other.isfinite()]
    scale = float(finite.abs().max()) if finite.numel() else 1.0
    apart = float(torch.where(same, 0.0, (mine - other).abs()).max())
    return apart / scale if scale else apart


def check_together(
    functions: dict[str, Function], inputs: Inputs, tolerance: float = 1e-12
) -> float:
    """Values and gradients of all functions against eager torch; the largest difference.

    `inputs` are repeated as need be: function number i is differentiated at sample i.
    """
    names = list(functions)
    together = Together(list(functions.values()), inputs)
    batch = len(next(iter(inputs.all.values())))
    at = inputs.rows([i % batch for i in range(len(names))])
    floating = [i for i, r in enumerate(together.results) if r.is_floating_point()]
    size = sum(together.results[i].numel() for i in floating)
    dtype = together.program.layout.real.dtype
    weights = torch.zeros(len(names), size, dtype=dtype)
    generator = torch.Generator().manual_seed(len(names))
    for i in floating:
        offset, count = together.program.layout.carry_places[i][1], together.results[i].numel()
        weights[i, offset : offset + count] = torch.randn(count, generator=generator, dtype=dtype)
    found = together.run(at, weights)
    values, gradients = together.split((found[0], found[1])), together.gradients(found[2:], at)
    worst, wrong = 0.0, []
    for i, name in enumerate(names):
        offset, result = together.program.layout.carry_places[i][1], together.results[i]
        seed = torch.zeros(result.shape, dtype=dtype)
        if i in floating:
            seed = weights[i, offset : offset + result.numel()].reshape(result.shape)
        value, expected = eager_gradients(functions[name], at.sample(i), seed)
        errors = {"value": difference(values[i][i], value)}
        if result.is_floating_point():
            mine = {n: g[i] for n, g in gradients.items()}
            scale = max((float(g.abs().max()) for g in expected.values() if g.numel()), default=0)
            for n, g in expected.items():
                same = (mine[n] == g) | (mine[n].isnan() & g.isnan())
                apart = torch.where(same, 0.0, (mine[n] - g).abs())
                error = float(apart.max()) / (scale or 1.0) if g.numel() else 0.0
                errors[f"gradient to {n}"] = float("inf") if error != error else error
        bad = {k: e for k, e in errors.items() if not e <= tolerance}
        worst = max(worst, *errors.values()) if not bad else worst
        if bad:
            wrong.append(f"{name}: " + ", ".join(f"{k} {e:.1e}" for k, e in bad.items()))
    assert not wrong, "\n".join(wrong)
    return worst


def _leaf(x: Tensor) -> Leaf:
    return Leaf(tuple(x.shape), KINDS[x.dtype])


def _rows(tensors: Sequence[Tensor], floating: bool, batch: int) -> Tensor:
    rows = [row_of([t[b] for t in tensors], floating) for b in range(batch)]
    return torch.cat(rows)
