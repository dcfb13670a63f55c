"""Every key rule keeps its contract, and `check_key_rule` refuses what does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.errors import InterfaceError
from mann_torch.memory import KEY_RULES, KeyRule, RepresentationKeys, StateKeys
from mann_torch.testing import check_key_rule


@pytest.mark.parametrize("name", KEY_RULES)
def test_a_key_rule_of_the_library_keeps_its_contract(name: str) -> None:
    check_key_rule(KEY_RULES[name]())


def changed(**members: Any) -> KeyRule:
    """State keys that break a line."""
    return type("Broken", (StateKeys,), members)(2.0)  # type: ignore[no-any-return]


def of(name: str, compute: Callable[..., Any]) -> KeyRule:
    """With another result of a method, of the right one and its arguments."""
    right = getattr(StateKeys, name)
    return changed(**{name: lambda self, *given: compute(right(self, *given), *given)})


def _scaled(right: Any, hidden: Tensor, context: Tensor, memory: Any, gain: Tensor) -> Any:
    return right._replace(query=right.query + gain.mean())


BROKEN: dict[str, tuple[Callable[[], KeyRule], str]] = {
    "half a number": (lambda: changed(width=lambda self, C: C / 2), r"line 1: width\(2\) = 1.0"),
    "keys of another width": (
        lambda: changed(width=lambda self, C: C + 1),
        r"line 2: the keys has shape \(8, 5, 3\), not \(8, 5, 2\)",
    ),
    "a query alone": (
        lambda: of("query_keys", lambda right, *_: right.query),
        "line 2: query_keys gives a Tensor",
    ),
    "a scale a slot": (
        lambda: of("query_keys", lambda right, *_: right._replace(scale=right.keys[..., 0])),
        r"line 2: the scale has shape \(8, 5\), not \(8,\)",
    ),
    "a rate of another form": (
        lambda: of("rate", lambda right, *_: right.sum(-1)),
        "line 3: ",
    ),
    "keys that drift": (
        lambda: of("derivative", lambda right, *_: right + 0.1),
        "line 3: a key of weight 0 moves",
    ),
    "a rate that is none": (
        lambda: changed(
            derivative=lambda self, weights, context, memory: (
                0.5 * weights.unsqueeze(-1) * (context.unsqueeze(-2) - memory.keys)
            )
        ),
        "line 3: keys do not relax as fast as `rate` says",
    ),
    "fresh keys elsewhere": (
        lambda: of("fresh_keys", lambda right, *_: 1.1 * right),
        "line 4: a fresh key moves in the context",
    ),
    "samples that mix": (
        lambda: of("query_keys", _scaled),
        "line 5: sample 0 of a batch has another query_keys",
    ),
    "a detached context": (
        lambda: of("query_keys", lambda right, *_: right._replace(query=right.query.detach())),
        "line 5: the gradient of query_keys by the context is not what finite",
    ),
    "a context it denies": (
        lambda: changed(compares_context=False),
        "line 5: it compares the context",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_key_rule_is_refused_by_what_is_wrong(name: str) -> None:
    make, told = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"^\w+, contract .*(?:{told})"):
        check_key_rule(make())


def test_what_is_no_key_rule_is_named() -> None:
    with pytest.raises(mt.KindError, match="rule = 3"):
        check_key_rule(3)  # type: ignore[arg-type]


def test_contents_are_keys_without_a_motion_of_their_own() -> None:
    rule = RepresentationKeys()
    assert rule.width(7) == 0 and not bool(rule.rate(torch.ones(5, dtype=torch.float64)).any())
