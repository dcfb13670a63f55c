"""docs/deploy.md is run as it stands."""

from __future__ import annotations

from tests.pages import executed


def test_the_page_runs() -> None:
    names = executed("deploy.md")
    assert "q_1 acceleration" in names["printed"]
    assert names["flags"] == 1
