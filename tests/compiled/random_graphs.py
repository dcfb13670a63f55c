"""Random small functions of a sample's tensors, each with its text."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from .marching import Function, Inputs

#: No value grows larger than this.
LARGEST = 48

Maker = Callable[[random.Random, Tensor], tuple[str, Callable[[Tensor], Tensor]] | None]


def inputs(samples: int, seed: int) -> Inputs:
    """Numbers of order 1, whole numbers below 3, and a mask."""
    g = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(samples, *shape, generator=g, dtype=torch.float64)

    whole = torch.randint(-3, 3, (samples, 4), generator=g)
    mask = torch.rand(samples, 4, generator=g) > 0.5
    mask[:, 0] = True
    return Inputs(
        {"a": normal(3, 4), "b": normal(4), "c": normal(), "k": whole, "m": mask},
        {"x": normal(2, 3), "y": normal(3, 3), "z": normal(1, 4)},
    )


#: One operand: text with {0}, over float tensors.
UNARY = """
torch.tanh({0})|torch.sin({0})|torch.cos(2.0 * {0})|torch.sigmoid({0})|torch.exp(-{0}.abs())
torch.exp(0.5 * torch.tanh({0}))|torch.log(1.5 + {0}.square())|torch.log1p({0} * {0})
torch.sqrt(1.0 + {0} ** 2)|torch.expm1(torch.tanh({0}))|torch.atan({0})|torch.erf({0})|{0}.abs()
-{0}|{0} / 3.0|1.0 / (2.0 + {0} ** 2)|{0} - 0.25|2.0 - {0}|{0}.clamp(-0.7, 0.6)|torch.relu({0})
torch.nn.functional.softplus({0})|torch.nn.functional.gelu({0})|torch.nn.functional.elu({0})
torch.sign({0}) * {0} ** 2|torch.asin(0.9 * torch.tanh({0}))|torch.sinh(torch.tanh({0}))
torch.pow(1.2 + {0}.abs(), 1.7)|torch.pow({0}, 3)|torch.floor(3.0 * {0}) + {0}|{0}.mT if {0}.dim() > 1 else {0}
torch.where({0} > 0.1, {0}, 0.3 * {0})|torch.where({0}.abs() < 0.5, {0}.square(), torch.cos({0}))
torch.nn.functional.silu({0})|{0}.clone().mul_(1.5).add_(0.2)
{0}.flatten()|{0}.reshape(-1).flip(0)|{0}.unsqueeze(-1)|{0}.unsqueeze(0)|{0}.squeeze()
torch.zeros_like({0}) + {0}|{0} * torch.tensor(1.25, dtype=torch.float64)|torch.rad2deg({0}) / 50.0
""".replace("\n", "|").strip("|").split("|")  # fmt: skip
#: One operand of at least one dimension; D is one of them.
ALONG = """
{0}.sum(D)|{0}.mean(D, keepdim=True)|{0}.amax(D)|{0}.amin(D, keepdim=True)|{0}.prod(D)|{0}.cumsum(D)
torch.softmax({0}, D)|torch.log_softmax({0}, D)|torch.logsumexp({0}, D)|{0}.std(D, correction=0)
torch.linalg.vector_norm({0} + 2.0, dim=D)|{0}.sort(D).values|{0}.topk(1, D).values|{0}.flip(D)
{0}.select(D, 0)|{0}.select(D, -1)|{0}.narrow(D, 0, 1)|torch.cat([{0}, 0.5 * {0}], D)|{0}.max(D).values
torch.stack([{0}, {0}.cos()], D)|torch.roll({0}, 1, D)|{0}.argmax(D).double() + {0}.amax(D)
{0}.gather(D, {0}.argsort(D))|{0}.chunk(2, D)[0]|{0}.unbind(D)[0]|{0} - {0}.mean(D, keepdim=True)
({0} > {0}.mean(D, keepdim=True)).double() * {0}|{0}.repeat_interleave(2, D)|{0}.cumprod(D)
torch.nn.functional.pad({0}, (1, 0)).diff(dim=-1)|{0}.movedim(D, 0)|{0}.index_select(D, torch.tensor([0]))
""".replace("\n", "|").strip("|").split("|")  # fmt: skip
#: One operand of at least two dimensions.
MATRIX = """
{0}.transpose(0, 1)|{0}[0]|{0}[:, 0]|{0}[..., ::2]|{0}[-1:]|{0}.diagonal()|{0}.sum()|{0}.tril()|{0}.triu()
{0} @ {0}.mT|torch.einsum('...ij->...ji', {0})|{0}.mean((-2, -1))|{0}.unflatten(0, (1, -1))|{0}.mT.flatten()
torch.linalg.solve({0} @ {0}.mT + 2.0 * torch.eye({0}.shape[-2], dtype=torch.float64), {0})
torch.linalg.inv({0} @ {0}.mT + 2.0 * torch.eye({0}.shape[-2], dtype=torch.float64))
torch.linalg.det({0} @ {0}.mT / 4.0 + torch.eye({0}.shape[-2], dtype=torch.float64))
torch.linalg.norm({0} + 1.0)|torch.diag_embed({0}[..., 0])
""".replace("\n", "|").strip("|").split("|")  # fmt: skip
#: Two operands that broadcast.
BINARY = """
{0} + {1}|{0} - {1}|{0} * {1}|{0} / (1.5 + {1} ** 2)|torch.maximum({0}, {1})|torch.minimum({0}, {1})
torch.atan2({0}, 1.5 + {1}.abs())|torch.where({0} > {1}, {0}, 2.0 * {1})|torch.hypot({0}, {1} + 3.0)
torch.addcmul({0}, {1}, {1}, value=-0.5)|torch.lerp({0}, {1}, 0.3)|({0} < {1}) * {0} + {1}
torch.logaddexp({0}, {1})|torch.fmod({0}, 1.3 + {1}.abs()) + {0}|torch.copysign({0}, {1}) + {1}
torch.where(torch.logical_or(({0} > 0) & ({1} < 0.5), {0} < -1), {1}, {0})|{0} * ({1} != 0.0)
""".replace("\n", "|").strip("|").split("|")  # fmt: skip
#: Of named inputs.
SPECIAL = """
s['a'] @ s['b']|s['y'] @ s['a']|s['x'] @ s['y']|torch.outer(s['b'], s['b'])|s['b'].dot(s['b'])
torch.einsum('ij,j->i', s['a'], s['b'])|s['a'][:, s['k']]|s['b'][s['k']]|torch.linalg.solve(s['y'] + 4.0 * torch.eye(3, dtype=torch.float64), s['a'])
torch.where(s['m'], s['b'], -torch.inf).softmax(0)|s['b'] * s['m']|s['k'] * s['b']|(s['k'] // 2).double() * s['b']
torch.zeros(3, dtype=torch.float64).scatter_add(0, s['k'] % 3, s['b'])|torch.nn.functional.one_hot(s['k'].abs(), 4).double() @ s['a'].mT
s['a'].index_add(1, s['k'] % 4, s['a'])|torch.masked_fill(s['a'], s['m'], 0.5)|s['a'][s['k'] % 3, 1]|torch.arange(4, dtype=torch.float64) * s['b']
torch.cross(s['y'], s['x'][:1].expand(3, 3), dim=-1)|torch.linspace(0, 1, 4, dtype=torch.float64) + s['z']
""".replace("\n", "|").strip("|").split("|")  # fmt: skip


def random_graph(seed: int, example: dict[str, Tensor]) -> tuple[str, Function]:
    """A function and its text: a chain of operations, each on values made before."""
    draw = random.Random(seed)
    lines: list[str] = []
    values: dict[str, Tensor] = {f"s['{n}']": v for n, v in example.items() if n in "abcxyz"}
    while len(lines) < draw.randint(3, 8):
        text = _operation(draw, values)
        try:
            value = eval(text, {"torch": torch}, {"s": example, **_locals(values)})
        except (RuntimeError, IndexError, TypeError):
            continue  # shapes that do not fit
        if not 0 < value.numel() <= LARGEST or not bool((value.abs() < 30).all()):
            continue
        name = f"v{len(lines)}"
        lines.append(f"{name} = {text}")
        values[name] = value
    last = [f"v{i}" for i in range(max(0, len(lines) - 2), len(lines))]
    lines.append("return torch.cat([" + ", ".join(f"{v}.reshape(-1)" for v in last) + "])")
    body = "def f(s):\n" + "\n".join("    " + line for line in lines)
    names: dict[str, Any] = {"torch": torch}
    exec(compile(body, f"graph {seed}", "exec"), names)
    return body, names["f"]


def _locals(values: dict[str, Tensor]) -> dict[str, Tensor]:
    return {n: v for n, v in values.items() if n.isidentifier()}


def _operation(draw: random.Random, values: dict[str, Tensor]) -> str:
    names = list(values)
    x = draw.choice(names[-3:] if draw.random() < 0.6 else names)
    kind = draw.choice("uuabbms")
    if kind == "u":
        return draw.choice(UNARY).format(x)
    if kind == "b":
        return draw.choice(BINARY).format(x, draw.choice(names))
    if kind == "s":
        return draw.choice(SPECIAL)
    dims = values[x].dim()
    if kind == "m" and dims >= 2:
        return draw.choice(MATRIX).format(x)
    return (
        draw.choice(ALONG).format(x).replace("D", str(draw.randrange(-dims, dims) if dims else 0))
    )
