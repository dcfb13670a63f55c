"""`check_key_rule`: whether a key rule keeps the contract that memories build on."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..memory import KeyRule
from ..types import Comparison, MemoryState
from .attention_bench import CONTEXT, HIDDEN, SLOTS
from .forms import called, check_held, check_tensor
from .functions import ROUNDING, SAMPLES, apart, check_function, tried_of
from .slopes import check_constants, check_slopes
from .telling import broken


class Kept(NamedTuple):
    """What a key rule is given."""

    hidden: Tensor  # (SAMPLES, N)
    context: Tensor  # (SAMPLES, C)
    memory: MemoryState
    write_gain: Tensor  # (SAMPLES,)
    weights: Tensor  # (SAMPLES, S)


def check_key_rule(rule: KeyRule) -> None:
    """Raise `InterfaceError` where a key rule breaks a line of its contract, which it names.

    Tried on 5 slots of 6 features, in a context of 2 numbers. Raises `KindError` for what is no
    `KeyRule`.
    """
    instance("rule", rule, KeyRule)
    check_held(rule, 5)
    width = called(rule, 1, f"width({CONTEXT})", partial(rule.width, CONTEXT))
    if isinstance(width, bool) or not isinstance(width, int) or width < 0:
        raise broken(rule, 1, f"width({CONTEXT}) = {width!r}", "give a whole number, 0 for none")
    given = _drawn(width)
    _check_comparison(rule, given)
    _check_motion(rule, given, width)
    _check_fresh(rule, given, width)
    names = ["the features", "the context", "the contents", "the keys", "the write gain"]
    for what, of in (("query_keys", _compared), ("derivative", _moved), ("fresh_keys", _fresh)):
        tried = tried_of(rule, 5, what, of, given)
        if sum(leaf.numel() for leaf in tried()):
            check_function(tried)
            check_slopes(tried, names)
            check_constants(tried, 5)


def _drawn(width: int) -> Kept:
    generator = torch.Generator().manual_seed(0)

    def draw(*shape: int) -> Tensor:
        return torch.randn(SAMPLES, *shape, generator=generator, dtype=torch.float64)

    memory = MemoryState(0.4 * draw(SLOTS, HIDDEN), draw(SLOTS, width))
    gain = 0.75 + 0.05 * torch.arange(SAMPLES, dtype=torch.float64)
    weights = draw(SLOTS).softmax(dim=-1)
    return Kept(torch.sigmoid(draw(HIDDEN)), draw(CONTEXT), memory, gain, weights)


def _compared(rule: KeyRule, given: Kept) -> Comparison:
    return rule.query_keys(given.hidden, given.context, given.memory, given.write_gain)


def _moved(rule: KeyRule, given: Kept) -> Tensor:
    return rule.derivative(given.weights, given.context, given.memory)


def _fresh(rule: KeyRule, given: Kept) -> Tensor:
    return rule.fresh_keys(given.context)


def _check_comparison(rule: KeyRule, given: Kept) -> None:
    found = called(rule, 2, "query_keys of a batch", partial(_compared, rule, given))
    if not isinstance(found, Comparison):
        kind = type(found).__name__
        raise broken(rule, 2, f"query_keys gives a {kind}", "return a Comparison")
    K = found.query.shape[-1] if isinstance(found.query, Tensor) else 0
    check_tensor(rule, 2, "the query", found.query, (SAMPLES, K), "(..., K)")
    check_tensor(rule, 2, "the keys", found.keys, (SAMPLES, SLOTS, K), "(..., S, K)")
    shape = (SAMPLES,) if getattr(found.scale, "ndim", 0) else ()
    check_tensor(rule, 2, "the scale", found.scale, shape, "(...,)")
    if rule.compares_context:
        return
    other = _compared(rule, given._replace(context=given.context.flip(0)))
    if apart([found.query, found.keys], [other.query, other.keys]) > 0:
        raise broken(rule, 5, "it compares the context", "say `compares_context = True`")


def _check_motion(rule: KeyRule, given: Kept, width: int) -> None:
    shape = (SAMPLES, SLOTS, width)
    found = called(rule, 3, "derivative of a batch", partial(_moved, rule, given))
    check_tensor(rule, 3, "derivative", found, shape, "(..., S, D)")
    rate = called(rule, 3, "rate of a batch", partial(rule.rate, given.weights))
    check_tensor(rule, 3, "rate", rate, (SAMPLES, SLOTS), "(..., S)")
    still = _moved(rule, given._replace(weights=torch.zeros_like(given.weights)))
    if bool((still != 0).any()):
        mend = "what is not attended keeps its key: multiply by the weights"
        raise broken(rule, 3, "a key of weight 0 moves", mend)
    if not width or not bool((rate != 0).any()):
        return
    aside = torch.sin(torch.arange(width, dtype=torch.float64) + 1.0)
    keys = given.memory.keys + aside
    farther = _moved(rule, given._replace(memory=given.memory._replace(keys=keys)))
    if apart([farther], [found - rate.unsqueeze(-1) * aside]) > ROUNDING:
        mend = "derivative = rate (what it follows - key), or leave `rate` out: Euler's step then"
        raise broken(rule, 3, "keys do not relax as fast as `rate` says", mend)


def _check_fresh(rule: KeyRule, given: Kept, width: int) -> None:
    fresh = called(rule, 4, "fresh_keys of a batch", partial(_fresh, rule, given))
    check_tensor(rule, 4, "fresh_keys", fresh, (SAMPLES, width), "(..., D)")
    keys = fresh.unsqueeze(-2).expand(SAMPLES, SLOTS, width)
    moved = _moved(rule, given._replace(memory=given.memory._replace(keys=keys)))
    if apart([moved], [torch.zeros_like(moved)]) > ROUNDING:
        mend = "a fresh key is what `derivative` follows"
        raise broken(rule, 4, "a fresh key moves in the context that it is written in", mend)
