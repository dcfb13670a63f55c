"""A reference of one's own held to the contract of `mann_torch.signals.Reference`."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.func import jvp, vmap

from ..checks import POSITIVE, instance, number
from ..signals import Reference
from ..telling import explained
from .reference_rows import check_registered, leaves_of, members, numbers_in, scaled_copies
from .reference_samples import given, name_of, same
from .telling import broken

#: Beside its size, how far a derivative may be from the one by autograd.
DERIVATIVE = 1e-9


def check_reference(reference: Reference, horizon: float = 10.0) -> None:
    """Hold a reference to its contract at times from 0 to `horizon` [s].

    Raises `InterfaceError`, which names the line of the contract (see `Reference`) that is broken,
    what was found and what to mend; `KindError` for what is no `Reference`.
    """
    instance("reference", reference, Reference)
    end = number("horizon", horizon, POSITIVE)
    check_registered(reference)
    generator = torch.Generator().manual_seed(0)
    t = end * torch.rand(12, generator=generator, dtype=torch.float64)
    _check_form(reference, t)
    # Where pieces meet: 0 and whatever numbers its rows hold.
    knots = torch.cat([t.new_zeros(1), numbers_in(reference)])
    _check_finite(reference, torch.cat([t, knots]))
    _check_derivatives(reference, t)
    _check_from_the_right(reference, knots)
    _check_copies(reference, t)
    _check_batch(reference, t)
    _check_gradients(reference, torch.cat([t, knots]))
    _check_vmap(reference, t)


def _check_form(reference: Reference, t: Tensor) -> None:
    batch = (*reference.batch_shape, reference.width)
    for times in (t[0], t, t.reshape(3, 4)):
        wanted = (*times.shape, *batch)
        for k, part in enumerate(given(reference, times)):
            if part.dtype != torch.float64:
                raise broken(
                    reference, 3, f"{name_of(k)} is {part.dtype}", "compute in float64 throughout"
                )
            if part.shape != wanted:
                raise broken(
                    reference,
                    3,
                    f"{name_of(k)} has shape {tuple(part.shape)}, not {wanted}, at t of shape "
                    f"{tuple(times.shape)}",
                    "each member of the sample broadcasts t with rows (..., p), p the `width`",
                )


def _check_finite(reference: Reference, t: Tensor) -> None:
    for k, part in enumerate(given(reference, t)):
        bad = ~torch.isfinite(part).flatten(1).all(dim=1)
        if bool(bad.any()):
            raise broken(
                reference,
                3,
                f"{name_of(k)} is not finite at t = {t[bad][0].item()}",
                "guard what `where` chooses between",
            )


def _check_derivatives(reference: Reference, t: Tensor) -> None:
    parts = given(reference, t)

    def lower(u: Tensor) -> tuple[Tensor, ...]:
        return given(reference, u)[:-1]

    if reference.order < 1:
        return
    found = jvp(lower, (t,), (torch.ones_like(t),))[1]
    for k, (claimed, slope) in enumerate(zip(parts[1:], found, strict=True), start=1):
        size = max(claimed.abs().max(), slope.abs().max(), 1e-6 * parts[k - 1].abs().max())
        off = (claimed - slope).abs().flatten(1).amax(dim=1)
        if bool((off > DERIVATIVE * size).any()):
            at = t[off.argmax()].item()
            raise broken(
                reference,
                3,
                f"{name_of(k)} is not the derivative of {name_of(k - 1)} in time: they differ by "
                f"{off.max().item():.3g} at t = {at:.6g}",
                f"mend {name_of(k)}, or give a smaller `order`; t must not be detached",
            )


def _check_from_the_right(reference: Reference, t: Tensor) -> None:
    step = 1e-9 * (1.0 + t.abs())
    now, soon, later = (given(reference, t + k * step)[0].flatten(1) for k in range(3))
    jumped = (soon - now).abs() > 100.0 * (later - soon).abs() + 1e-6 * now.abs().max()
    if bool(jumped.any()):
        raise broken(
            reference,
            4,
            f"it jumps just after t = {t[jumped.any(dim=1)][0].item():.6g}",
            "compare with t >= the time of the jump, not t >",
        )


def _check_copies(reference: Reference, t: Tensor) -> None:
    """`expand`, `stack` and `select` give references that go on giving the same."""
    batch, parts = tuple(reference.batch_shape), given(reference, t)
    copies: dict[str, Callable[[], Reference]] = {
        "expand": lambda: reference.expand((2, *batch)),
        "stack": lambda: reference.stack([reference, reference]),
        "select": lambda: reference.expand((3, *batch)).select([0, 2]),
    }
    for name, make in copies.items():
        mend = f"`{name}` comes of rows registered by `hold`; do not override it"
        try:
            copy = make()
        except Exception as error:
            raise broken(reference, 1, f"{name} raised {explained(error)}", mend) from error
        if copy.batch_shape != (2, *batch):
            found = tuple(copy.batch_shape)
            raise broken(reference, 1, f"{name} gave batch shape {found}, not {(2, *batch)}", mend)
        for k, part in enumerate(given(copy, t)):
            wanted = parts[k].unsqueeze(1)
            if part.shape != (len(t), 2, *parts[k].shape[1:]) or not same(part, wanted):
                raise broken(
                    reference, 1, f"after {name} {name_of(k)} is not what it was before", mend
                )


def _check_batch(reference: Reference, t: Tensor) -> None:
    """Members of a batch, and each alone; and `aligned` beside `forward`."""
    batch = scaled_copies(reference, 3)
    together = given(batch, t)
    for i, alone in enumerate(members(batch)):
        for k, part in enumerate(given(alone, t)):
            if not same(together[k][:, i], part):
                raise broken(
                    reference,
                    3,
                    f"{name_of(k)} of a sample depends on the batch it is in",
                    "compute all of any batch at once, without a view across samples",
                )
    shape = tuple(batch.batch_shape)
    own = t[:3].reshape(3, *(1,) * (len(shape) - 1)).expand(shape)
    for k, part in enumerate(given(batch, own, "aligned")):
        wanted = torch.stack([together[k][i, i] for i in range(3)])
        if part.shape != wanted.shape or not same(part, wanted):
            raise broken(
                reference,
                3,
                f"{name_of(k)} of `aligned`, each sample at its own time, is not that of `forward`",
                "leave both as they are, and let `at` take t (..., 1)",
            )


def _check_gradients(reference: Reference, t: Tensor) -> None:
    copy, leaves = leaves_of(reference)
    if not leaves:
        return
    total = sum((part.square().sum() for part in given(copy, t)), t.new_zeros(()))
    mend = "rows must reach `at` as they are: no detach, no numbers taken out of them"
    if not total.requires_grad:
        raise broken(reference, 3, "no gradient reaches any of its rows", mend)
    found = torch.autograd.grad(total, list(leaves.values()), allow_unused=True)
    for name, gradient in zip(leaves, found, strict=True):
        if gradient is not None and not bool(torch.isfinite(gradient).all()):
            raise broken(
                reference,
                3,
                f"the gradient of {name} is not finite",
                "`where` leaks NaN gradients: guard the arguments of what is not chosen",
            )


def _check_vmap(reference: Reference, t: Tensor) -> None:
    parts = given(reference, t)
    mapped = vmap(lambda u: given(reference, u))(t)
    if not all(same(one, other) for one, other in zip(mapped, parts, strict=True)):
        raise broken(
            reference, 3, "under torch.func.vmap over t it gives other values", "use t alone"
        )
