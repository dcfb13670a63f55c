"""Torch-only maths shared by memory, control and plants. Shapes as in `types`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from .checks import shown, wrong
from .errors import ConfigError, DtypeError, KindError

#: What stands for float64 numbers of any shape: numbers, rows of them, a tensor.
Numbers = float | Sequence[float] | Sequence[Sequence[float]] | Tensor


def as_float64(value: Numbers, what: str = "value") -> Tensor:
    """Return `value` as a float64 tensor.

    Raises `DtypeError` for a tensor of another dtype, `KindError` for what is no number (a bool is
    none), `ConfigError` for rows of unequal length.

    A tensor that requires grad is passed through, so that gradients reach it.
    """
    if isinstance(value, Tensor):
        if value.dtype != torch.float64:
            raise DtypeError(
                f"{what} is {value.dtype}; this library computes in float64 only "
                "(float32 time has steps of 3e-5 s at t = 329 s): convert it with .double()"
            )
        return value
    if _has_bool(value):
        raise wrong(what, value, "numbers, and a bool is none")
    try:
        return torch.tensor(value, dtype=torch.float64)
    except TypeError as error:
        raise KindError(f"{what} = {shown(value)} is not made of numbers: {error}") from None
    except (ValueError, OverflowError, RuntimeError) as error:
        raise ConfigError(
            f"{what} = {shown(value)} is not made of numbers in rows: {error}"
        ) from None


def _has_bool(value: object) -> bool:
    if isinstance(value, list | tuple):
        return any(map(_has_bool, value))
    return isinstance(value, bool) or "bool" in str(getattr(value, "dtype", ""))


def number_by_number(x: Tensor) -> Tensor:
    """x in a layout that torch's elementwise functions take one number at a time.

    In a contiguous tensor the numbers after the last whole vector go another way, and come out
    different in the last bit: a sample's would depend on its place in the batch.
    """
    return x.unsqueeze(-1).expand(*x.shape, 2).contiguous()[..., 0]


def row_times(x: Tensor, A: Tensor) -> Tensor:
    """x' A: (..., a), (..., a, b) -> (..., b)."""
    return (x.unsqueeze(-2) @ A).squeeze(-2)


def times_column(A: Tensor, x: Tensor) -> Tensor:
    """A x: (..., a, b), (..., b) -> (..., a)."""
    return (A @ x.unsqueeze(-1)).squeeze(-1)


def per_matrix(constant: Tensor) -> Tensor:
    """A constant per sample, ready to scale matrices: (...,) -> (..., 1, 1)."""
    return constant.unsqueeze(-1).unsqueeze(-1)


def outer(a: Tensor, b: Tensor) -> Tensor:
    """a b': (..., a), (..., b) -> (..., a, b)."""
    return a.unsqueeze(-1) * b.unsqueeze(-2)


def frobenius(A: Tensor) -> Tensor:
    """Frobenius norm (..., a, b) -> (...,); its gradient at 0 is 0, not NaN."""
    return torch.linalg.vector_norm(A, dim=(-2, -1))


def solve_small(A: Tensor, B: Tensor) -> Tensor:
    """Solve A X = B: (..., n, n), (..., n, k) -> (..., n, k).

    Closed form for n <= 2 (it fuses and keeps a singular sample's inf or NaN to itself), LU
    without a singularity check beyond that, for the same reason.
    """
    n = A.shape[-1]
    if n == 1:
        return B / A
    if n == 2:
        a, b, c, d = A.flatten(-2).unsqueeze(-2).unbind(-1)
        top, bottom = B.unbind(-2)
        solved = torch.stack([d * top - b * bottom, a * bottom - c * top], dim=-2)
        return solved / (a * d - b * c).unsqueeze(-1)
    return torch.linalg.solve_ex(A, B, check_errors=False).result


def infinity_distances(query: Tensor, keys: Tensor) -> Tensor:
    """|query - key_i|_inf: (..., D), (..., S, D) -> (..., S)."""
    return (query.unsqueeze(-2) - keys).abs().amax(dim=-1)


def active_distances(query: Tensor, keys: Tensor, active: Tensor) -> Tensor:
    """|query - key_i|_inf of the active slots, inf for the others. (..., S)"""
    return torch.where(active, infinity_distances(query, keys), torch.inf)


def one_hot(index: Tensor, size: int) -> Tensor:
    """Boolean one-hot rows: (...,) int64 -> (..., size)."""
    return torch.arange(size, device=index.device) == index.unsqueeze(-1)


def nearest_weights(query: Tensor, keys: Tensor, active: Tensor) -> Tensor:
    """Weight 1 on the active key nearest to the query in the infinity norm, 0 elsewhere.

    Paper: eqs. (indsel), (indsel-1) and (factdef). The lowest index wins a tie. (..., S)
    """
    distances = active_distances(query, keys, active)
    return one_hot(distances.argmin(dim=-1), keys.shape[-2]).to(query.dtype)


def masked_softmax(scores: Tensor, active: Tensor) -> Tensor:
    """Softmax over the active slots; 0 on the others. (..., S)"""
    return torch.softmax(torch.where(active, scores, -torch.inf), dim=-1)


def pick(condition: Tensor, new: Tensor, old: Tensor) -> Tensor:
    """`torch.where` with the condition (...,) broadcast over trailing dimensions."""
    extra = new.dim() - condition.dim()
    return torch.where(condition.reshape(condition.shape + (1,) * extra), new, old)


def blend(degree: Tensor, new: Tensor, old: Tensor) -> Tensor:
    """`old` moved to `new` by a degree in [0, 1]; a boolean one picks. All three broadcast."""
    if degree.dtype == torch.bool:
        return torch.where(degree, new, old)
    return (1.0 - degree) * old + degree * new


#: Terms of `second_mean`'s series at 0: the next would be below 1e-17 where it is used.
_TERMS = 12


def second_mean(z: Tensor) -> Tensor:
    """(e^-z - 1 + z) / z^2 of z >= 0, 1/2 at 0: the weight of what grows where e^-z forgets.

    That of what stays, (1 - e^-z) / z, is 1 - z of it. Known as phi_2(-z) and phi_1(-z).
    """
    series = torch.full_like(z, (-1.0) ** _TERMS / math.factorial(_TERMS + 2))
    for k in reversed(range(_TERMS)):
        series = series * z + (-1.0) ** k / math.factorial(k + 2)
    near = z < 0.25
    far = torch.where(near, 1.0, z)
    return torch.where(near, series, (torch.expm1(-far) + far) / (far * far))
