"""What a controls engineer writes in torch, an expression each, over the tensors of `inputs`."""

from __future__ import annotations

import torch
from torch import Tensor

from .marching import Function, Inputs

#: Expressions by subject, with semicolons between them.
TABLE = {
    "arithmetic": r"""
a + b; a - b; a * b; a / p; a + v; a * w[:, None]; a + 2; 2 - a; a * 2.5; 3 / p; a % 0.7; k % 3
k // 2; -k // 3; -k % 3; torch.div(a, p, rounding_mode="trunc")
torch.div(k, 2, rounding_mode="trunc"); torch.div(-k, 3, rounding_mode="trunc")
torch.div(-k, 3, rounding_mode="floor"); torch.fmod(a, 0.7); torch.fmod(a, p); torch.fmod(-k, 3)
torch.remainder(a, p); torch.remainder(k, 3); torch.unravel_index(i, (2, 2))[0]
torch.round(a, decimals=-1); torch.fmod(a * 5, -p); torch.remainder(a * 5, -p)
(a * 10).detach() // 0.1; (a * 3).detach() // p.detach(); torch.remainder(2.0, p.detach())
(a * 7) % 0.1
""",
    "elementary functions": r"""
a.abs(); a.neg(); a.sin() + a.cos(); torch.tan(u); torch.asin(u) + torch.acos(u); torch.atan(a)
torch.atan2(a, b); torch.sinh(a) + torch.cosh(b); torch.tanh(a); torch.asinh(a); torch.acosh(p + 1)
torch.atanh(u); torch.exp(a); torch.exp2(a); torch.expm1(a); torch.log(p); torch.log2(p)
torch.log10(p); torch.log1p(p); torch.sqrt(p); torch.rsqrt(p); torch.reciprocal(p); torch.erf(a)
torch.erfc(a); torch.sigmoid(a); torch.special.expit(a); torch.logit(u / 2 + 0.5); torch.sign(a)
torch.sgn(a); torch.floor(a * 3); torch.ceil(a * 3); torch.round(a * 3); torch.trunc(a * 3)
torch.frac(a * 3); torch.round(a, decimals=2)
torch.heaviside(a.detach(), torch.tensor(0.5, dtype=torch.float64))
""",
    "powers and extremes": r"""
torch.square(a); a ** 2; a ** 3; a ** 4; a ** -1; p ** -2; p ** 0.5; p ** -0.5; p ** 1.5; p ** a
2.0 ** a; 2 ** a; a ** 0; a ** 1; k ** 2; torch.pow(p, b); torch.float_power(p, 1.7)
torch.hypot(a, b); torch.copysign(a, b); torch.copysign(a, torch.tensor(-1.0)); torch.deg2rad(a)
torch.rad2deg(a); torch.lerp(a, b, 0.3); torch.lerp(a, b, u); torch.addcmul(a, b, p, value=0.5)
torch.addcdiv(a, b, p, value=0.5); torch.maximum(a, b); torch.minimum(a, b); torch.fmax(a, b)
torch.fmin(a, b); torch.max(a, b); torch.clamp(a, -0.5, 0.5); torch.clamp(a, min=-0.5)
torch.clamp(a, max=0.3); torch.clamp(a, min=-p, max=p); a.clip(-0.1, None); torch.clamp(k, 0, 2)
""",
    "choices and activations": r"""
torch.nan_to_num(a); torch.where(n, a, b); torch.where(n, a, 0.0); torch.where(n, 1.0, a)
torch.where(a > 0, a, b * 2); torch.where(n, k, 0); torch.where(n, 1.0, 2.0).double()
a.masked_fill(n, 3.0); a.masked_fill(n, float("-inf")).softmax(-1); torch.nn.functional.softplus(a)
torch.nn.functional.softplus(a, beta=2.0, threshold=1.0); torch.nn.functional.relu(a)
torch.nn.functional.relu6(a); torch.nn.functional.elu(a); torch.nn.functional.celu(a)
torch.nn.functional.selu(a); torch.nn.functional.gelu(a)
torch.nn.functional.gelu(a, approximate="tanh"); torch.nn.functional.silu(a)
torch.nn.functional.mish(a); torch.nn.functional.leaky_relu(a)
torch.nn.functional.leaky_relu(a, 0.2); torch.nn.functional.hardtanh(a)
torch.nn.functional.hardsigmoid(a); torch.nn.functional.hardswish(a)
torch.nn.functional.hardshrink(a); torch.nn.functional.softshrink(a)
torch.nn.functional.tanhshrink(a); torch.nn.functional.softsign(a)
torch.nn.functional.logsigmoid(a); torch.nn.functional.threshold(a, 0.1, 0.0)
torch.nn.functional.prelu(a, v[:1]); torch.nn.functional.glu(c, dim=1)
torch.nn.functional.normalize(a, dim=-1); torch.nn.functional.normalize(a, dim=0)
""",
    "losses and layers": r"""
torch.nn.functional.mse_loss(a, b); torch.nn.functional.l1_loss(a, b)
torch.nn.functional.smooth_l1_loss(a, b); torch.nn.functional.huber_loss(a, b)
torch.nn.functional.binary_cross_entropy_with_logits(a, b); torch.nn.functional.linear(a, m)
torch.nn.functional.linear(a, m, v); torch.nn.functional.linear(v, m, v)
torch.nn.functional.bilinear(a, b, c[:, :3, :], None); torch.nn.functional.layer_norm(a, (3,))
torch.nn.functional.layer_norm(a, (3,), v, v, 1e-5); torch.nn.functional.layer_norm(a, (4, 3))
torch.nn.functional.rms_norm(a, (3,)); torch.nn.functional.group_norm(c, 2)
torch.nn.functional.cosine_similarity(a, b, dim=-1); torch.nn.functional.cosine_similarity(a, v)
torch.nn.functional.pairwise_distance(a, b); torch.nn.functional.one_hot(i, 5)
torch.nn.functional.pad(a, (1, 2)); torch.nn.functional.pad(a, (1, 2, 0, 1), value=0.5)
torch.nn.functional.pad(a, (-1, 1)); torch.nn.functional.pad(c, (1, 1), mode="reflect")
torch.nn.functional.softmax(a, -1); torch.nn.functional.log_softmax(a, 0)
torch.nn.functional.softmin(a, -1); torch.nn.functional.dropout(a, 0.0)
torch.nn.functional.dropout(a, 0.5, training=False)
torch.nn.functional.scaled_dot_product_attention(c, c, c); torch.cdist(a, b)
""",
    "sums and norms": r"""
a.sum(); a.sum(0); a.sum(-1, keepdim=True); c.sum((0, 2)); c.sum((0, 2), keepdim=True); a.mean()
a.mean(0); c.mean((0, 1), keepdim=True); a.prod(); a.prod(1); a.amax(); a.amax(0)
c.amax((0, 2), keepdim=True); a.amin(-1); a.max(); a.min(); a.max(0).values; a.min(-1).values
a.max(0).indices; a.min(1, keepdim=True).indices; a.median(0).values; a.median()
torch.aminmax(a, dim=0).max; a.norm(); a.norm(dim=1); a.norm(p=1, dim=0); a.norm(p=3, dim=0)
a.norm(p=float("inf"), dim=0); torch.linalg.norm(a); torch.linalg.norm(v)
torch.linalg.norm(a, dim=-1); torch.linalg.norm(a, ord=1, dim=-1)
torch.linalg.norm(a, ord=float("inf"), dim=0); torch.linalg.norm(a, ord="fro")
torch.linalg.norm(a, ord=1); torch.linalg.norm(a, ord=float("inf")); torch.linalg.vector_norm(a)
torch.linalg.vector_norm(a, 4, dim=1, keepdim=True)
torch.linalg.vector_norm(a, -float("inf"), dim=1); torch.linalg.vector_norm(a, 0, dim=1)
torch.linalg.matrix_norm(a); torch.dist(a, b); torch.logsumexp(a, 0); torch.logsumexp(c, (0, 1))
torch.logaddexp(a, b); a.var(); a.var(0); a.var(0, correction=0); a.std(); a.std(1, keepdim=True)
a.std(1, unbiased=False); torch.var_mean(a, 0)[0]; torch.std_mean(a, 0)[0]
""",
    "scans and tests": r"""
a.cumsum(0); a.cumsum(-1); k.cumsum(0); a.cumprod(1); a.cummax(0).values; a.cummin(0).values
torch.cumulative_trapezoid(a, dx=0.1); torch.trapezoid(a, dx=0.1); torch.trapz(a, p.cumsum(-1))
torch.diff(a, dim=0); torch.diff(a); torch.gradient(a, spacing=0.1, dim=0)[0]; torch.any(n)
torch.all(n, dim=0); n.any(-1, keepdim=True); n.sum(); n.sum(0); n.double().mean()
torch.count_nonzero(n); torch.count_nonzero(a > 0, dim=0); k.sum(); k.sum(0); k.prod(0); k.amax(0)
k.max(); k.argmax(0); a.argmax(); a.argmin(0); a.argmax(-1, keepdim=True); a.argmax(keepdim=True)
""",
    "orders": r"""
a.topk(2).values; a.topk(2, dim=0, largest=False).values; a.topk(2).indices; a.sort().values
a.sort(0, descending=True).values; a.sort(0, descending=True).indices; torch.argsort(a, dim=0)
torch.argsort(k, dim=0, stable=True); a.kthvalue(2, dim=0).values; a.quantile(0.3); torch.msort(a)
torch.sort(a, dim=0).values.cumsum(0); a.cummax(1).indices; k.cummin(0).values
torch.searchsorted(v.sort().values, a, right=True); torch.bucketize(s, v.sort().values, right=True)
""",
    "shapes": r"""
a.T; a.mT; a.t(); c.permute(2, 0, 1); c.transpose(0, -1); c.swapaxes(0, 1); c.movedim(0, -1)
c.reshape(-1); c.reshape(6, 4); c.flatten(); c.flatten(1); c.permute(2, 1, 0).flatten()
c.unflatten(1, (2, 2)); c.view(4, 6); c.ravel(); a.unsqueeze(1); a[None].squeeze(0)
a.expand(2, 4, 3); v.expand(4, -1); v.repeat(2, 3); v.tile(2); v.repeat_interleave(2)
a.repeat_interleave(2, dim=0); torch.broadcast_to(v, (4, 3)); torch.flip(a, (0,)); torch.fliplr(a)
torch.rot90(a); torch.roll(a, 1, 0); torch.roll(a, -2); torch.roll(a, (1, 1), (0, 1)); a[1:]; a[::2]
a[:, 1]; a[-1]; a[..., -1]; a[1:3, :2]; a[:, None, 1:]; a.select(0, 2); a.narrow(1, 1, 2)
""",
    "joining and diagonals": r"""
torch.cat([a, b]); torch.cat([a, b], -1); torch.cat([a, torch.zeros(0, 3, dtype=a.dtype)])
torch.cat([a[:0], b]); torch.stack([a, b]); torch.stack([a, b], -1); torch.hstack([a, b])
torch.vstack([v, v]); torch.dstack([a, b]); torch.column_stack([v, v]); torch.concat([v, v])
torch.atleast_2d(v); torch.stack([v[0] * v[1], v[2].sin(), v[1]])
torch.stack([torch.cos(s), -torch.sin(s), torch.sin(s), torch.cos(s)]).reshape(2, 2)
torch.cat([c[:, 1], c[:, 2]], 1).split(3, 1)[0]; sum(a.split(2)); sum(c.chunk(2, 1)).sum(0)
torch.cat(c.tensor_split(3, dim=1)[1:], 1); torch.stack(a.unbind(0)[::-1]); torch.stack(a.unbind(1))
torch.meshgrid(v, w, indexing="ij")[0]; torch.cartesian_prod(v, w); torch.block_diag(m, m)
torch.diag(v); torch.diag(m); torch.diag_embed(v); torch.diag_embed(a, offset=1); torch.diagonal(a)
torch.diagonal(a, 1); torch.diagonal(c, -1, 1, 2); torch.diagflat(v); torch.tril(m); torch.triu(m)
torch.tril(m, -1); torch.triu(m, 1); torch.trace(m); torch.eye(3, dtype=a.dtype) @ m
torch.kron(m[:2, :2], m); torch.outer(v, w); torch.ger(v, w); torch.inner(a, b)
""",
    "products": r"""
torch.dot(v, v); v @ v; a @ v; w @ a; a @ m; a.mT @ b; c @ m; m @ c.mT; torch.mm(a, m)
torch.mv(a, v); torch.bmm(c, c.mT); torch.matmul(c, v); torch.addmm(a, a, m)
torch.addmm(a, a, m, beta=0.5, alpha=2.0); torch.addmv(w, a, v, beta=0.5, alpha=2.0)
torch.baddbmm(c[:, :, :1], c, c.mT[:, :, :1], beta=0.3); torch.addr(a, w, v)
torch.tensordot(a, b, dims=2); torch.tensordot(a, b, dims=([0], [0]))
torch.einsum("ij,kj->ik", a, b); torch.einsum("ij,ij->", a, b); torch.einsum("bij,bkj->bik", c, c)
torch.einsum("i,j->ij", v, w); torch.einsum("ii->i", m); torch.einsum("...ij,j->...i", c, v)
torch.einsum("ij,jk,kl->il", a, m, m); torch.linalg.multi_dot([a, m, v]); torch.matrix_power(m, 3)
torch.linalg.matrix_power(m, -1)
""",
    "systems": r"""
torch.linalg.solve(m, v); torch.linalg.solve(m, a.mT); torch.linalg.solve(m, a, left=False)
torch.linalg.solve(mm, c[:, :3]); torch.linalg.inv(m); torch.inverse(m); torch.linalg.inv(mm)
torch.linalg.det(m); torch.det(mm); torch.logdet(spd); torch.linalg.slogdet(m)[1]
torch.linalg.slogdet(m).logabsdet; torch.linalg.slogdet(m).sign; torch.linalg.cholesky(spd)
torch.cholesky_solve(a.mT, torch.linalg.cholesky(spd))
torch.cholesky_inverse(torch.linalg.cholesky(spd))
torch.linalg.solve_triangular(torch.triu(m), a.mT, upper=True)
torch.linalg.solve_triangular(torch.tril(m), a.mT, upper=False)
torch.linalg.solve_triangular(torch.tril(m).mT, a, upper=True, left=False)
torch.linalg.solve_triangular(torch.tril(m), a.mT, upper=False, unitriangular=True)
torch.linalg.lu_solve(*torch.linalg.lu_factor(m), a.mT); torch.linalg.solve(a.mT @ a, a.mT @ w)
torch.linalg.tensorinv(m[None].reshape(3, 3), ind=1); torch.linalg.cross(a, b)
torch.cross(a, b, dim=-1); torch.linalg.vecdot(a, b); torch.linalg.vander(v)
torch.linalg.cholesky(mm @ mm.mT + torch.eye(3, dtype=a.dtype))
torch.linalg.cholesky(spd, upper=True)
torch.cholesky_solve(c[:, :3], torch.linalg.cholesky(mm @ mm.mT + torch.eye(3, dtype=a.dtype)))
torch.linalg.solve_triangular(torch.tril(mm), c[:, :3], upper=False); torch.linalg.det(mm)
torch.linalg.slogdet(mm)[0]; torch.cdist(a, b, p=1.0); torch.cdist(c, c.flip(1))
torch.linalg.det(m.mT); torch.linalg.det(m.mT @ m); torch.linalg.det(mm.mT)
torch.linalg.slogdet(m.mT)[1]; torch.logdet(spd.mT); torch.eye(3, 4, dtype=a.dtype) @ a
torch.eye(2).double() @ v[:2]; torch.var_mean(a)[1]; torch.linalg.solve(m[:1, :1], v[:1])
torch.matrix_exp(m * 0.1); torch.linalg.matrix_exp(3.0 * mm); torch.matrix_exp(m[:1, :1] - 40.0)
torch.linalg.solve(m[:2, :2], v[:2]); torch.linalg.inv(m[:2, :2]); torch.linalg.inv(m[:1, :1])
torch.linalg.solve(big, big[0]); torch.linalg.inv(big); torch.linalg.solve(m.flip(0), v)
torch.linalg.solve(m - torch.diag(torch.diag(m)), v)
""",
    "rows by index": r"""
a.index_select(0, i); a[i]; a[i, i % 3]; a[j]; a[:, j % 3]; a[j, 1]; a[j, j % 3]; a[1:][j % 3]
c[:, j]; c[..., j % 3]; c[0, j, :]; v[j % 3]; w[i]; w[k]; w[i - 2]; a[[0, 2]]
a[torch.tensor([0, 2])]; c[:, [1, 0], :]; c[[0, 1], :, [2, 1]]; a.gather(0, i[:, None].expand(4, 3))
a.index_select(1, i[:2] % 3); a[:, i[:2] % 3]; a[i[:, None], i[:2] % 3]
torch.nn.functional.one_hot(k, 4) * a[..., None]; a[torch.stack([j, j])]; a[:, None, j % 3]
a[None, j]; a[-1 - j]; k[j]; n[j]; a[i, j % 3]; torch.cat([a[j], c[0, j]])
torch.gather(w, 0, j[None]).squeeze(0); torch.take_along_dim(w, j[None], 0)
torch.nn.functional.embedding(i, a)
torch.lerp(w[j.clamp(max=2)], w[j.clamp(max=2) + 1], s.sigmoid()); a[torch.stack([j, j * 0])]
a[..., None][j]
""",
    "scattering": r"""
a.gather(1, k % 3); a.gather(1, k[:2, :2] % 3); torch.take_along_dim(a, a.argsort(0), 0)
torch.take(a, i); a.scatter(0, i[None, :3], b[:1]); a.scatter(1, k[:, :1] % 3, 2.5)
a.scatter(1, k[:, :1] % 3, b[:, :1]); a.scatter_add(1, k % 3, b); a.scatter_add(0, k[:2], b[:2])
a.index_add(0, i, b); a.index_add(0, i[:2], b[:2], alpha=2.0); a.index_copy(0, i[:1], b[:1])
a.index_fill(0, i[:2], 1.5); a.index_put((i[:1],), b[0]); a.index_put((i,), b, accumulate=True)
a.scatter_reduce(1, k % 3, b, "sum"); a.slice_scatter(b[1:3], 0, 1, 3); a.select_scatter(v, 0, 1)
a.diagonal_scatter(v); m.diagonal_scatter(v[:2], 1)
torch.bucketize(a, torch.tensor([-1.0, 0.0, 1.0], dtype=a.dtype))
torch.bucketize(a, v.sort().values); torch.searchsorted(v.sort().values, a)
torch.searchsorted(a.sort(-1).values, b); torch.searchsorted(v.sort().values, s)
torch.isclose(a, b)
""",
    "logic and whole numbers": r"""
torch.isnan(a); torch.isinf(a); torch.isfinite(a); torch.logical_and(n, a > 0)
torch.logical_or(n, k); torch.logical_xor(n, a > 0); torch.logical_not(n); n & (a > 0); n | (a > b)
n ^ (k > 1); ~n; k & 1; k | 2; k ^ 3; ~k; k << 1; k >> 1; a > b; a >= 0.5; k == 2
k != k.T.reshape(4, 3); n == (a > 0); a == a; k < 2.5; k + 1; k * n; n * a; n.double() * a; n + n
n * n; a * k; k.double(); a.long(); (a * 3).int().long(); a.bool(); k.bool(); n.long()
n.int().sum(); k.float().double(); a.to(torch.float64); a.to(k.dtype); a.type_as(b); k.abs(); -k
k.sign(); k.clamp_min(1); torch.maximum(k, k.flip(0)); k.max(0).values; -k // 2
torch.fmod(k - 2, 3); torch.div(k - 2, 3, rounding_mode="trunc"); k << 2; (k - 2) >> 1; (~k) & 3
""",
    "numbers made on the way": r"""
torch.arange(3, dtype=a.dtype) * v; torch.arange(0, 3) + k
torch.arange(0.0, 0.3, 0.1, dtype=a.dtype) * v; torch.linspace(0, 1, 3, dtype=a.dtype) * v
torch.linspace(0, 1, 3) * v; torch.logspace(0, 1, 3, dtype=a.dtype) * v; torch.tensor(2.0) * a
torch.tensor(0.1) * a; torch.tensor(0.1, dtype=a.dtype) * a; torch.tensor([0.1, 0.2, 0.3]) * v
torch.tensor([0.1, 0.2, 0.3], dtype=a.dtype) * v; a + torch.tensor(0.1)
torch.where(n, torch.tensor(0.1), a); torch.maximum(a, torch.tensor(0.1))
torch.as_tensor(0.1, dtype=torch.float64) * a; torch.full((3,), 0.1, dtype=a.dtype) * v
torch.full_like(a, 0.1) * a; torch.ones_like(a) * s; torch.zeros(4, 3, dtype=a.dtype) + a
torch.zeros_like(a) * a; torch.ones(3) * v; torch.zeros(3) + v; torch.eye(3).double() @ m
torch.empty_like(a).fill_(2.0) * a; a.new_zeros(4, 3) + a; a.new_tensor([1.0, 2.0, 3.0]) * a
a.new_full((3,), 0.1) * a; torch.tril(torch.ones(3, 3, dtype=a.dtype)) @ m
torch.tril_indices(3, 3)[0]; m[torch.tril_indices(3, 3)[0], torch.tril_indices(3, 3)[1]]
m[torch.triu_indices(3, 3).unbind(0)]; torch.special.xlogy(a, p); torch.special.entr(p)
torch.special.log1p(p); torch.special.sinc(a); torch.sinc(a); torch.special.ndtr(a)
torch.cumsum(a, 0).flip(0); torch.squeeze(a[:, :1]); a.squeeze()
torch.arange(0.0, 1.0, 0.3, dtype=a.dtype) * w; torch.tensor(0.1) * torch.tensor(0.3) * a
""",
    "ones, none and scalars": r"""
one.squeeze(); one.squeeze(0); one.sum(0); one * a; one.mean(0); one.softmax(0); one.amax(0)
one.argmax(0); one.var(0, correction=0); one.expand(4, 3); one.T @ one; one.cumsum(0)
one.max(0).values; zero.sum(); zero.sum(0); zero.prod(0); zero * 2; zero @ m; zero.T @ zero
torch.cat([zero, a]); torch.cat([zero, zero]); zero.mean(1); zero.softmax(-1); zero.norm(); s.sum()
s.mean(); s.max(); s.amax(); s.argmax(); s.softmax(0); s.cumsum(0); s.sort().values; s.norm()
s.reshape(1); s[None]; s.expand(3); s.unsqueeze(0).squeeze(); s.prod(); s * a; s.view(1, 1)
torch.atleast_1d(s); torch.stack([s, s * 2]); s.clone()
""",
    "transforms and views": r"""
a.clone(); a.detach() * a; a.contiguous(); a.double(); torch.vmap(lambda x: x.sin().sum())(a)
torch.vmap(lambda x, y: x @ y, (0, None))(a, v); torch.func.grad(lambda x: (x.sin() * x).sum())(a)
torch.func.jacrev(lambda x: m @ x)(v); torch.func.jacfwd(lambda x: (m @ x).sin())(v)
torch.func.hessian(lambda x: (x ** 3).sum())(v); torch.func.jvp(lambda x: x.sin(), (a,), (b,))[1]
torch.func.vjp(lambda x: x.sin(), a)[1](b)[0]; torch.nn.functional.unfold(c[None], (2, 2))
a.unfold(0, 2, 1); a.unfold(0, 2, 2); torch.renorm(a, 2, 0, 1.0); torch.clamp(a, min=v, max=v + 1)
torch.cumprod(p, 0); torch.ldexp(a, k); torch.isin(k, torch.tensor([1, 2])); a.swapdims(0, 1)
a.view_as(b); a.expand_as(c); a.reshape_as(b); a.nanmean(); a.nansum(); torch.std(a.flatten())
torch.floor(s).long(); a.addmm(a, m); a.unfold(1, 2, 1); a.unfold(-2, 3, 1)
torch.diagonal(c, 0, 2, 1); torch.diagonal(c, 1, 0, 2)
""",
}  # fmt: skip


def expressions(subject: str) -> list[str]:
    """The expressions of a subject."""
    lines = TABLE[subject].strip().splitlines()
    return [part.strip() for line in lines for part in line.split(";")]


def inputs(samples: int = 8) -> Inputs:
    """Constants and carried tensors of order 1, small whole numbers and masks."""
    g = torch.Generator().manual_seed(0)

    def normal(*shape: int) -> Tensor:
        return torch.randn(samples, *shape, generator=g, dtype=torch.float64)

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(samples, *shape, generator=g, dtype=torch.float64)

    def whole(high: int, *shape: int) -> Tensor:
        return torch.randint(0, high, (samples, *shape), generator=g)

    one, root = torch.eye(3, dtype=torch.float64), normal(3, 3)
    rows = torch.stack([torch.randperm(4, generator=g) for _ in range(samples)])
    constants = {
        "a": normal(4, 3),
        "v": normal(3),
        "p": uniform(0.5, 2.0, 4, 3),
        "m": normal(3, 3) + 2 * one,
        "mm": normal(2, 3, 3) + 2 * one,
        "big": normal(5, 5),
        "spd": root @ root.mT + one,
        "s": normal(),
        "i": rows,
        "j": whole(4),
        "n": normal(4, 3) > 0,
        "one": normal(1, 3),
        "zero": normal(0, 3),
    }
    carried = {
        "b": normal(4, 3),
        "w": normal(4),
        "c": normal(2, 4, 3),
        "u": uniform(-0.9, 0.9, 4, 3),
        "k": whole(4, 4, 3),
    }
    return Inputs(constants, carried)


def function(text: str) -> Function:
    """An expression as a function of a sample's tensors."""
    code = compile(text, text, "eval")
    return lambda sample: eval(code, {"torch": torch, **sample})
