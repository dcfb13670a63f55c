"""Single operations, modules and idioms: values and gradients against eager torch, 1e-12."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from .marching import Function, Inputs, Together, check_together, difference
from .operation_table import TABLE, expressions, function, inputs

QUICK = (
    "arithmetic", "choices and activations", "sums and norms", "shapes", "products", "systems",
    "rows by index", "logic and whole numbers", "ones, none and scalars",
)  # fmt: skip


@pytest.mark.parametrize(
    "subject", [s if s in QUICK else pytest.param(s, marks=pytest.mark.slow) for s in TABLE]
)
def test_operations(subject: str) -> None:
    texts = expressions(subject)
    worst = check_together({text: function(text) for text in texts}, inputs())
    print(f"{len(texts)} operations: largest difference {worst:.1e}")


MODULES: dict[str, tuple[Callable[[], nn.Module], tuple[tuple[int, ...], ...]]] = {
    "linear": (lambda: nn.Linear(3, 4), ((3,),)),
    "perceptron": (
        lambda: nn.Sequential(nn.Linear(3, 5), nn.Tanh(), nn.LayerNorm(5), nn.Linear(5, 2)),
        ((2, 3),),
    ),
    "bilinear": (lambda: nn.Bilinear(3, 4, 2), ((3,), (4,))),
    "gru": (lambda: nn.GRUCell(3, 4), ((3,), (4,))),
    "rnn": (lambda: nn.RNNCell(3, 4), ((3,), (4,))),
    "lstm": (lambda: nn.LSTMCell(3, 4), ((3,),)),
    "attention": (lambda: nn.MultiheadAttention(4, 2, batch_first=True), ((5, 4),) * 3),
    "rms": (lambda: nn.RMSNorm(3), ((4, 3),)),
    "groups": (lambda: nn.GroupNorm(2, 4), ((1, 4, 3),)),
    "prelu": (nn.PReLU, ((3,),)),
    "embedding": (lambda: nn.Sequential(nn.Flatten(0), nn.Softmax(0)), ((2, 3),)),
    "transformer": (
        lambda: nn.TransformerEncoderLayer(4, 2, 6, dropout=0.0, batch_first=True),
        ((5, 4),),
    ),
}


def test_modules() -> None:
    constants, carried, functions = {}, {}, {}
    for number, (name, (make, shapes)) in enumerate(MODULES.items()):
        torch.manual_seed(number)
        module = make().double()
        held = {f"{name}.{n}": p.detach() for n, p in module.named_parameters()}
        constants |= {n: p.expand(3, *p.shape).clone() for n, p in held.items()}
        given = [f"{name}:{i}" for i in range(len(shapes))]
        carried |= {
            n: torch.randn(3, *shape, dtype=torch.float64)
            for n, shape in zip(given, shapes, strict=True)
        }
        functions[name] = _called(name, module, given)
    check_together(functions, Inputs(constants, carried))


def _called(name: str, module: nn.Module, given: list[str]) -> Function:
    def call(sample: dict[str, Tensor]) -> Tensor:
        held = {n: sample[f"{name}.{n}"] for n, _ in module.named_parameters()}
        found = torch.func.functional_call(module, held, tuple(sample[n] for n in given))
        return found[0] if isinstance(found, tuple) else found

    return call


def test_infinities_nan_and_zeros_of_both_signs_are_as_in_torch() -> None:
    """Values alone; every pair of them for operations on two."""
    inf, nan = float("inf"), float("nan")
    numbers = torch.tensor([nan, inf, -inf, 0.0, -0.0, 1.0, -1.0, 2.5, 1e308, 5e-324]).double()
    a, b = numbers.repeat_interleave(10), numbers.repeat(10)
    texts = [part.strip() for line in SPECIAL.strip().splitlines() for part in line.split(";")]
    given = Inputs({"a": a[None], "b": b[None]}, {"r": torch.stack([a, b]).reshape(1, 20, 10)})
    together = Together([function(text) for text in texts], given)
    for count in (1, 9):
        found = together.split(together.run(given.rows([0] * count))[:2])  # type: ignore[arg-type]
        apart = {
            text: difference(mine[0], other)
            for text, mine, other in zip(texts, found, together.results, strict=True)
        }
        assert not {text: d for text, d in apart.items() if d > 1e-14}


SPECIAL = """
torch.maximum(a, b); torch.minimum(a, b); torch.fmax(a, b); torch.fmin(a, b); a.clamp(-1.0, 1.0)
torch.clamp(a, b, b + 1.0); torch.where(a > b, a, b); torch.where(a == b, 1.0, 0.0).double()
a > b; a >= b; a != b; torch.isnan(a); torch.isinf(a); torch.isfinite(a); r.amax(1); r.amin(1)
r.max(1).indices; r.argmax(1); r.argmin(1); r.argmax(0); r.sort(1).values; r.sort(1).indices
r.sort(1, descending=True).values; r.sort(1, descending=True).indices; r.topk(3, 1).values
r.sum(1); r.prod(1); r.mean(1); r.cumsum(1); r.cumprod(1); r.cummax(1).values; r.cummax(1).indices
r.cummin(1).values; r.median(1).values; r.median(1).indices; torch.nan_to_num(a); a.relu()
torch.nan_to_num(a / b, 1.0, 2.0, 3.0); torch.sign(a); torch.sgn(a); torch.floor(a); a.round()
a + b; a - b; a * b; a / b; torch.fmod(a, b); torch.remainder(a, b); torch.atan2(a, b); a // b
torch.hypot(a, b); torch.copysign(a, b); torch.pow(a, b); torch.exp(a); torch.log(a); a.log1p()
torch.sqrt(a); torch.tanh(a); torch.sigmoid(a); torch.sin(a); torch.erf(a); a.expm1(); a.rsqrt()
torch.reciprocal(a); r.softmax(1); r.logsumexp(1); r.log_softmax(1); r.norm(dim=1); r.any(1)
torch.linalg.vector_norm(r, float("inf"), dim=1); r.bool(); r.all(1); torch.heaviside(a, b)
torch.logaddexp(a, b); torch.nn.functional.softplus(a); torch.nn.functional.gelu(a)
torch.nn.functional.silu(a); torch.nn.functional.elu(a); torch.nn.functional.leaky_relu(a)
torch.nn.functional.hardtanh(a); torch.nn.functional.hardsigmoid(a); torch.lerp(a, b, 0.3)
torch.bucketize(a, torch.tensor([-1.0, 0.0, 1.0]).double()); torch.nansum(r); torch.nanmean(r, 0)
torch.bucketize(a, torch.tensor([-1.0, 0.0, 1.0]).double(), right=True)
"""
