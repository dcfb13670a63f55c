"""`check_attention` passes what is right, and refuses what is not by what is wrong."""

from __future__ import annotations

import pytest

import mann_torch as mt
from mann_torch.errors import InterfaceError
from mann_torch.testing import check_attention
from tests.contracts.broken_attentions import BROKEN, Good


def test_a_right_attention_of_ones_own_passes() -> None:
    check_attention(Good())
    check_attention(Good(), mt.StateKeys())
    with pytest.raises(mt.KindError, match="attention = 3"):
        check_attention(3)  # type: ignore[arg-type]
    with pytest.raises(mt.KindError, match="key_rule = 'state'"):
        check_attention(Good(), "state")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_attention_is_refused_by_what_is_wrong(name: str) -> None:
    make, told = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"^\w+, contract .*(?:{told})"):
        check_attention(make())
