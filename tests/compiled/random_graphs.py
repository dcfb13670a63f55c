"""Random small functions of a sample's tensors, each with its text."""

from __future__ import annotations

import random
import warnings
from typing import Any

import torch
from torch import Tensor

from .marching import Function, Inputs

#: No value grows larger than this.
LARGEST = 48


def put(x: Tensor, where: Any, value: Any) -> Tensor:
    """A copy of x with `value` assigned to a part."""
    x = x.clone()
    x[where] = value
    return x


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
torch.round(3.0 * {0}) + {0}|torch.frac({0})|torch.trunc(2.0 * {0}) * {0}|torch.acosh(1.5 + {0} ** 2)
torch.asinh({0})|torch.atanh(0.5 * torch.tanh({0}))|torch.cosh(torch.tanh({0}))|torch.erfc({0})
torch.exp2(torch.tanh({0}))|torch.log2(1.5 + {0} ** 2)|torch.log10(1.5 + {0} ** 2)|torch.rsqrt(1.0 + {0} ** 2)
torch.nan_to_num({0})|torch.nn.functional.leaky_relu({0})|torch.nn.functional.hardtanh({0})
torch.nn.functional.mish({0})|torch.nn.functional.logsigmoid({0})|torch.nn.functional.celu({0})
torch.stack(({0}, -{0})).amax(0)|torch.fmod({0}, 0.7) + {0}|torch.remainder({0}, 0.7)|{0}.long().double() * {0}
torch.where(torch.isfinite({0}), {0}, 0.0)|({0}.detach() // 0.3) * {0}|(1.5 + {0}.abs()) ** -1.5|({0}[None] + {0}[None]).squeeze(0)
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
{0}.var(D)|{0}.norm(p=1, dim=D)|torch.linalg.vector_norm({0}, float('inf'), D)|{0}.median(D).values|{0}.kthvalue(1, D).values
{0}.cummax(D).values|{0}.cummin(D).values|torch.nn.functional.normalize({0} + 2.0, dim=D)|{0}.diff(dim=D)
{0}.scatter_add(D, {0}.argsort(D), {0}.sin())|torch.take_along_dim({0}, {0}.argsort(D), D)|{0}.unfold(D, 1, 1)
{0}.scatter(D, {0}.argmax(D, keepdim=True), 0.5)|{0}.argmin(D, keepdim=True).double() + {0}|{0}.tensor_split(2, D)[0]
({0} > 0).any(D).double()|({0} > 0).all(D, keepdim=True) * {0}|torch.count_nonzero({0} > 0, D).double()|{0}.quantile(0.3, D)
{0}.index_fill(D, torch.tensor([0]), 0.25)|{0}.index_add(D, torch.tensor([0]), {0}.narrow(D, 0, 1))|torch.roll({0}, -1, D)
{0}.index_select(D, torch.tensor([-1 % {0}.shape[D], 0]))|torch.cat([{0}.narrow(D, 0, 0), {0}], D)|torch.nn.functional.softmin({0}, D)
put({0}.movedim(D, 0), 0, 0.5)|put({0}.movedim(D, 0), slice(1, None), {0}.movedim(D, 0)[:-1])|put({0}.movedim(D, 0), -1, {0}.movedim(D, 0)[0].cos())
put({0}.movedim(D, 0), slice(None, None, 2), 0.1)|{0}.movedim(D, 0)[s['k'][0] % 1]|{0}.movedim(D, 0)[s['k'] % {0}.shape[D]]
torch.searchsorted({0}.movedim(D, -1).sort(-1).values.contiguous(), {0}.movedim(D, -1).contiguous()).double() + {0}.movedim(D, -1)
""".replace("\n", "|").strip("|").split("|")  # fmt: skip
#: One operand of at least two dimensions.
MATRIX = """
{0}.transpose(0, 1)|{0}[0]|{0}[:, 0]|{0}[..., ::2]|{0}[-1:]|{0}.diagonal()|{0}.sum()|{0}.tril()|{0}.triu()
{0} @ {0}.mT|torch.einsum('...ij->...ji', {0})|{0}.mean((-2, -1))|{0}.unflatten(0, (1, -1))|{0}.mT.flatten()
torch.linalg.solve({0} @ {0}.mT + 2.0 * torch.eye({0}.shape[-2], dtype=torch.float64), {0})
torch.linalg.inv({0} @ {0}.mT + 2.0 * torch.eye({0}.shape[-2], dtype=torch.float64))
torch.linalg.det({0} @ {0}.mT / 4.0 + torch.eye({0}.shape[-2], dtype=torch.float64))
torch.linalg.norm({0} + 1.0)|torch.diag_embed({0}[..., 0])
torch.linalg.cholesky({0} @ {0}.mT + 2.0 * torch.eye({0}.shape[-2], dtype=torch.float64))|{0}.diagonal(1).sum()
torch.linalg.slogdet({0} @ {0}.mT + torch.eye({0}.shape[-2], dtype=torch.float64))[1]|torch.kron({0}[:2, :2], {0}[:2, :1])
torch.linalg.solve_triangular({0} @ {0}.mT + 3.0 * torch.eye({0}.shape[-2], dtype=torch.float64), {0}, upper=False)
torch.nn.functional.pad({0}, (1, 0, 0, 2))|torch.nn.functional.pad({0}, (-1, 1), value=0.5)|{0}.triu(1)|{0}.tril(-1)
put({0}, (slice(1, None), 0), 0.5)|put({0}, (..., -1), {0}[..., 0].sin())|put({0}, ({0} > 0.3), 0.3)|torch.tensordot({0}, {0}, 2)
torch.einsum('...ij,...kj->...ik', {0}, {0})|torch.einsum('...ij->...i', {0})|torch.cdist({0}, {0} + 1.0)|{0}.repeat(2, 1)
({0} @ {0}.mT).diagonal(dim1=-2, dim2=-1)|torch.block_diag({0}[:2, :2], {0}[:1, :1])|{0}.expand(2, *{0}.shape)|torch.rot90({0})
torch.nn.functional.layer_norm({0}, ({0}.shape[-1],))|torch.nn.functional.cosine_similarity({0}, {0} + 1.0, dim=-1)
torch.nn.functional.scaled_dot_product_attention({0}, {0}, {0})|{0}.var((-2, -1))|{0}.logsumexp((-2, -1))|{0}.amax((-2, -1), keepdim=True)
""".replace("\n", "|").strip("|").split("|")  # fmt: skip
#: Two operands that broadcast.
BINARY = """
{0} + {1}|{0} - {1}|{0} * {1}|{0} / (1.5 + {1} ** 2)|torch.maximum({0}, {1})|torch.minimum({0}, {1})
torch.atan2({0}, 1.5 + {1}.abs())|torch.where({0} > {1}, {0}, 2.0 * {1})|torch.hypot({0}, {1} + 3.0)
torch.addcmul({0}, {1}, {1}, value=-0.5)|torch.lerp({0}, {1}, 0.3)|({0} < {1}) * {0} + {1}
torch.logaddexp({0}, {1})|torch.fmod({0}, 1.3 + {1}.abs()) + {0}|torch.copysign({0}, {1}) + {1}
torch.where(torch.logical_or(({0} > 0) & ({1} < 0.5), {0} < -1), {1}, {0})|{0} * ({1} != 0.0)
torch.fmax({0}, {1})|torch.fmin({0}, {1})|torch.clamp({0}, {1} - 0.5, {1} + 0.5)|torch.addcdiv({0}, {1}, 1.5 + {1} ** 2, value=0.3)
torch.remainder({0}, 1.3 + {1}.abs().detach())|torch.cat([{0}.flatten(), {1}.flatten()])|torch.dist({0} + 3.0, {1})
torch.stack(torch.broadcast_tensors({0}, {1}))|torch.bucketize({0}, {1}.flatten().sort().values.contiguous()).double() * {1}.sum()
torch.nn.functional.smooth_l1_loss(*torch.broadcast_tensors({0}, {1} + 0.3))|torch.xlogy({0}, 1.5 + {1} ** 2)|torch.atan2({0} + 5.0, {1})
torch.outer({0}.flatten(), {1}.flatten()[:3])|({0} >= {1}).double().sum() * {0}|torch.where({0} > {1}, 0.5, {0})|torch.heaviside({0}.detach(), {1}.detach()) * {0}
""".replace("\n", "|").strip("|").split("|")  # fmt: skip
#: Of named inputs.
SPECIAL = """
s['a'] @ s['b']|s['y'] @ s['a']|s['x'] @ s['y']|torch.outer(s['b'], s['b'])|s['b'].dot(s['b'])
torch.einsum('ij,j->i', s['a'], s['b'])|s['a'][:, s['k']]|s['b'][s['k']]|torch.linalg.solve(s['y'] + 4.0 * torch.eye(3, dtype=torch.float64), s['a'])
torch.where(s['m'], s['b'], -torch.inf).softmax(0)|s['b'] * s['m']|s['k'] * s['b']|(s['k'] // 2).double() * s['b']
torch.zeros(3, dtype=torch.float64).scatter_add(0, s['k'] % 3, s['b'])|torch.nn.functional.one_hot(s['k'].abs(), 4).double() @ s['a'].mT
s['a'].index_add(1, s['k'] % 4, s['a'])|torch.masked_fill(s['a'], s['m'], 0.5)|s['a'][s['k'] % 3, 1]|torch.arange(4, dtype=torch.float64) * s['b']
torch.cross(s['y'], s['x'][:1].expand(3, 3), dim=-1)|torch.linspace(0, 1, 4, dtype=torch.float64) + s['z']
s['a'][:, s['k'][0]]|s['a'][s['k'][1] % 3, s['k'][0]]|s['y'][s['k'][0] % 2] * s['b'][:3]|torch.stack([s['b'][3], s['b'][1]])
(s['k'] & 1).double() * s['b']|torch.where(s['k'] % 2 == 0, s['b'], -s['b'])|s['k'].cumsum(0).double()|s['k'].sort().values * s['b']
torch.eye(3, dtype=torch.float64) @ s['y']|torch.tensor([0.1, 0.2, 0.3, 0.4]) * s['b']|torch.tensor(0.1) * s['x']|torch.linspace(0, 1, 4) * s['b']
torch.linalg.lu_solve(*torch.linalg.lu_factor(s['y'] + 4.0 * torch.eye(3, dtype=torch.float64)), s['x'].mT)|torch.logical_xor(s['m'], s['k'] > 0) * s['b']
s['m'].long().cumsum(0) * s['b']|torch.stack([s['c'].cos(), -s['c'].sin(), s['c'].sin(), s['c'].cos()]).reshape(2, 2) @ s['x']
s['b'].gather(0, s['k'] % 4)|s['b'].scatter(0, s['k'][:1] % 4, s['a'][0, :1])|s['a'][[0, 2]][:, [1, 1]]|s['a'][[0, 2], :][:, s['k'] % 4]
torch.trapezoid(s['a'], dx=0.1)|torch.einsum('ij,kj,k->i', s['a'], s['a'], s['y'][0])
""".replace("\n", "|").strip("|").split("|")  # fmt: skip


def random_graph(seed: int, example: dict[str, Tensor]) -> tuple[str, Function]:
    """A function and its text: a chain of operations, each on values made before."""
    draw = random.Random(seed)
    lines: list[str] = []
    values: dict[str, Tensor] = {f"s['{n}']": v for n, v in example.items() if n in "abcxyz"}
    while len(lines) < draw.randint(2, 6):
        text = _operation(draw, values)
        if example["a"].dtype == torch.float32:
            text = text.replace("torch.float64", "torch.float32").replace(".double()", ".float()")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of what will not be taken
                value = eval(text, {"torch": torch, "put": put}, {"s": example, **_locals(values)})
        except (RuntimeError, IndexError, TypeError):
            continue  # shapes that do not fit
        if not 0 < value.numel() <= LARGEST or not bool((value.abs() < 30).all()):
            continue
        name = f"v{len(lines)}"
        lines.append(f"{name} = {text}")
        values[name] = value
    unread = [
        f"v{i}" for i in range(len(lines)) if not any(f"v{i}" in line for line in lines[i + 1 :])
    ]
    lines.append("return torch.cat([" + ", ".join(f"{v}.reshape(-1)" for v in unread) + "])")
    body = f"def f(s):  # graph {seed}\n" + "\n".join("    " + line for line in lines)
    names: dict[str, Any] = {"torch": torch, "put": put}
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
