"""What tests of deployment share."""

from __future__ import annotations

import pytest

from mann_torch.deployment.c_code import folder


@pytest.fixture
def unmeasured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exports without sizes in their README: two runs of compilers less."""
    monkeypatch.setattr(folder, "_sizes", lambda *_: [])
