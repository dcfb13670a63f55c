"""`check_attention`: whether an attention keeps the contract that memories build on."""

from __future__ import annotations

import torch
from torch import Tensor

from ..memory import Attention, KeyRule, RepresentationKeys
from ..memory.attention.attention import attention_of
from ..memory.keys import key_rule_of
from ..types import Shift
from .attention_bench import (
    SLOTS,
    Compared,
    Judged,
    compared,
    distances_of,
    judged,
    weights_of,
)
from .forms import called, check_held, check_tensor
from .functions import ROUNDING, SAMPLES, apart, check_function, tried_of
from .slopes import check_constants, check_slopes
from .telling import broken

#: Beside 1, what rounding may do to a sum of weights; how many draws are tried for decisions.
SUM, DRAWS = 1e-14, 8


def check_attention(attention: Attention, key_rule: KeyRule | None = None) -> None:
    """Raise `InterfaceError` where an attention breaks a line of its contract, which it names.

    Tried on 5 slots, compared as the key rule does, `RepresentationKeys()` if not given. Raises
    `KindError` for what is no `Attention` or `KeyRule`.
    """
    attention_of(attention)
    rule = RepresentationKeys() if key_rule is None else key_rule_of(key_rule)
    check_held(attention, 2)
    for name in ("reallocates", "switches", "starts_full", "graded"):
        value = getattr(attention, name)
        if not isinstance(value, bool):
            raise broken(attention, 5, f"{name} = {value!r}", f"set `{name}` to True or False")
    for seed in range(DRAWS):
        _check_weights(attention, compared(attention, rule, seed))
        if attention.switches:
            _check_switching(attention, compared(attention, rule, seed))
    given = compared(attention, rule)
    tried = tried_of(attention, 2, "forward", weights_of, given)
    check_function(tried)
    _check_permuted(attention, given)
    names = ["the query", "the keys", "the scale"]
    check_slopes(tried._replace(line=4), names)
    check_constants(tried, 4)
    _check_finite_at_rest(attention, compared(attention, rule, at_rest=True))
    _check_decisions(attention)


def _check_weights(attention: Attention, given: Compared) -> None:
    call = "forward of a batch of comparisons"
    found = called(attention, 2, call, lambda: weights_of(attention, given))
    weights = check_tensor(attention, 1, "forward", found, (SAMPLES, SLOTS), "(..., S)")
    if bool((weights < 0).any()):
        raise broken(attention, 1, "a weight is negative", "weights say how much is read of a slot")
    if bool((weights[given.active == 0] != 0).any()):
        raise broken(
            attention, 1, "an inactive slot has a weight", "mask it: `functional.masked_softmax`"
        )
    if float((weights.sum(dim=-1) - 1.0).abs().max()) > SUM:
        raise broken(
            attention,
            1,
            f"weights sum to {weights.sum(dim=-1)[0].item():.6g}",
            "divide them by their sum",
        )


def _check_permuted(attention: Attention, given: Compared) -> None:
    order = torch.tensor([3, 0, 4, 1, 2])
    keys = given.comparison.keys[:, order]
    other = Compared(given.comparison._replace(keys=keys), given.active[:, order])
    mine, theirs = weights_of(attention, given)[:, order], weights_of(attention, other)
    if apart([mine], [theirs]) > ROUNDING:
        raise broken(
            attention,
            3,
            "other weights where the slots are in another order",
            "a slot's weight may depend on its key and activity, not on its number",
        )


def _check_switching(attention: Attention, given: Compared) -> None:
    """One slot at a time, that of the least distance."""
    distances = called(
        attention,
        6,
        "distances of a batch of comparisons",
        lambda: attention.distances(given.comparison, given.active),
    )
    check_tensor(
        attention,
        6,
        "distances of active slots",
        torch.where(given.active > 0, distances, 0.0),
        (SAMPLES, SLOTS),
        "(..., S)",
    )
    if bool(distances[given.active == 0].isfinite().any()):
        raise broken(
            attention, 6, "an unused slot has a finite distance", "torch.where(active, ..., inf)"
        )
    nearest = torch.nn.functional.one_hot(distances.argmin(dim=-1), SLOTS)
    if not torch.equal(weights_of(attention, given), nearest.to(torch.float64)):
        raise broken(
            attention,
            6,
            "it `switches`, but the slot of the least distance does not have all the weight",
            "events are located where `distances` cross: compute weights from them",
        )


def _check_finite_at_rest(attention: Attention, given: Compared) -> None:
    """All slots start alike, at no distance."""
    for what, of in (("forward", weights_of), ("distances", distances_of)):
        if what == "distances" and not attention.switches:
            continue
        query = given.comparison.query.clone().requires_grad_()
        comparison = given.comparison._replace(query=query)
        with torch.enable_grad():
            value = of(attention, given._replace(comparison=comparison)).square().sum()
        if not value.requires_grad:
            continue
        (found,) = torch.autograd.grad(value, query, materialize_grads=True)
        if not bool(found.isfinite().all()):
            raise broken(
                attention,
                4,
                f"the gradient of {what} is not finite where keys equal the query, as they start",
                "guard roots, norms and divisions at 0",
            )


def _check_decisions(attention: Attention) -> None:
    given = judged(attention)
    what = "decide_shift of a batch of distances"
    shift = called(attention, 5, what, lambda: attention.decide_shift(*given))
    if not attention.reallocates:
        if shift is not None:
            mend = "say `reallocates = True`, or give None"
            raise broken(attention, 5, "decide_shift decides, though it never reallocates", mend)
        return
    if not isinstance(shift, Shift):
        found = f"decide_shift gives a {type(shift).__name__}"
        raise broken(attention, 5, found, "return a Shift, or do not say `reallocates`")
    kind = torch.float64 if attention.graded else torch.bool
    shapes = ((SAMPLES,), (SAMPLES, SLOTS))
    for name, value, shape in zip(shift._fields, shift, shapes, strict=True):
        if not isinstance(value, Tensor) or value.shape != shape or value.dtype != kind:
            found = getattr(value, "dtype", type(value).__name__)
            raise broken(
                attention,
                5,
                f"{name} of its Shift is {found} {tuple(getattr(value, 'shape', ()))}",
                f"give {kind} of shape {shape}: (...,) and (..., S)",
            )
    _check_target(attention, given, shift)
    decided = tried_of(attention, 2, "decide_shift", lambda a, g: a.decide_shift(*g), given)
    check_function(decided)
    check_constants(decided._replace(line=4), 4)


def _check_target(attention: Attention, given: Judged, shift: Shift) -> None:
    share = shift.target.to(torch.float64)
    total = share.sum(dim=-1)
    within = bool((share >= 0).all()) and bool((total <= 1.0 + ROUNDING).all())
    if not within or (not attention.graded and bool((total != 1.0).any())):
        raise broken(attention, 5, "its Shift is not to one slot", "target is 1 on that slot alone")
    degree = shift.fires.to(torch.float64)
    if bool(((degree < 0) | (degree > 1)).any()):
        raise broken(attention, 5, "a degree is outside [0, 1]", "fires says how much of a reset")
    if not attention.switches:
        return
    margin = called(attention, 6, "margin", lambda: attention.margin(*given))
    if tuple(margin.shape) != (SAMPLES,) or not torch.equal(margin >= 0, degree > 0.5):
        raise broken(
            attention,
            6,
            "margin is not >= 0 where, and only where, decide_shift fires",
            "give min R - theta, and -inf where no reset can come",
        )
