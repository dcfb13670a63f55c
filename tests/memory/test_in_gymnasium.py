"""docs/reinforcement.md, run as printed: a policy with a memory learns what to remember."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import torch

PAGE = Path(__file__).parents[2] / "docs" / "reinforcement.md"


def test_the_policy_beats_whoever_does_not_remember() -> None:
    (snippet,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    names: dict[str, Any] = {}
    exec(compile(snippet, str(PAGE), "exec"), names)
    assert np.mean(names["won"][:5]) < 0.5
    assert np.mean(names["won"][-5:]) > 0.9  # of 1; without a memory 1/3
    policy, shown, new = names["policy"], names["shown"], names["new"]
    again, _ = policy(shown, reset=new)
    stream = names["MemoryStream"](policy.memory.cell, shown.shape[1])
    state = stream.initial_state()
    with torch.no_grad():  # acting and learning see the same numbers
        for step in range(len(shown)):
            remembered, state = stream(shown[step], stream.begun(state, new[step]))
            scores = policy.scores(remembered)
            torch.testing.assert_close(scores, again[step], rtol=0, atol=1e-5)
