"""docs/compiling.md does what it says: its code runs as printed."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch

import mann_torch as mt
from tests.conftest import make_loop, make_scenario

PAGE = (Path(__file__).parent.parent / "docs" / "compiling.md").read_text()
REASONS = [line.split("|")[1].strip() for line in PAGE.splitlines() if line.startswith("| ")][1:]


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    names: dict[str, Any] = {}
    snippets = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    assert len(snippets) == 3
    for snippet in snippets:
        exec(compile(snippet, "docs/compiling.md", "exec"), names)
    return names


def test_the_pages_loops_are_explained(page: dict[str, Any]) -> None:
    found = page["found"]
    assert found.engine == "compiled" and found.n_state == 136 and found.mode == {}
    assert found.state["V"] == (10, 10) and sum(found.operations.values()) > 100
    assert found.steps_per_second > 10 * page["slow"].steps_per_second > 0
    (printed,) = re.findall(r"```(?:text)?\n(engine .*?)```", PAGE, re.S)
    names = [line.split()[0] for line in printed.splitlines()]
    assert names == [line.split()[0] for line in str(found).splitlines()]


def test_a_decision_on_data_is_named_and_mended(page: dict[str, Any]) -> None:
    slow, quick = page["slow"], page["quick"]
    assert slow.engine == "eager" and slow.operations == {}
    assert slow.reason.startswith(REASONS[0]) and "in Stops" in slow.reason
    assert quick.engine == "compiled"


def test_what_is_printed_is_what_is_returned(capsys: pytest.CaptureFixture[str]) -> None:
    scenario = make_scenario(330.0)
    plain, hybrid = (
        mt.explain(make_loop("reallocating_always"), scenario, gradient=gradient)
        for gradient in ("plain", "hybrid")
    )
    assert capsys.readouterr().out == f"{plain}\n{hybrid}\n"
    assert plain.engine == hybrid.engine == "compiled" and plain.operations != hybrid.operations
    assert set(plain.mode) == {"active", "attended", "switches", "reallocations"}


def test_a_batch_and_another_solver_are_explained() -> None:
    loop = make_loop("nn")
    loop.controller.initialize(base_gain=torch.tensor([10.0, 20.0, 30.0], dtype=torch.float64))
    found = mt.explain(loop, make_scenario(1.0), mt.Odeint("dopri5"))
    assert found.batch == (3,) and found.engine == "eager" and "dopri5" in found.reason
    assert "3 trajectories" in str(found)
    with pytest.raises(mt.ConfigError, match="gradient"):
        mt.explain(loop, make_scenario(1.0), gradient="exact")


class Spectral(mt.TwoLinkArm):
    def load(self, q: torch.Tensor, qd: torch.Tensor, coefficients: Any) -> torch.Tensor:
        moved = torch.linalg.eigvalsh(torch.diag_embed(q))
        return super().load(q, qd, coefficients) + 0.01 * moved


class Drawing(mt.TwoLinkArm):
    def load(self, q: torch.Tensor, qd: torch.Tensor, coefficients: Any) -> torch.Tensor:
        return super().load(q, qd, coefficients) + 0.01 * torch.randn_like(q)


class Holding(mt.TwoLinkArm):
    def __init__(self) -> None:
        super().__init__()
        self.held = [torch.tensor(1.1, dtype=torch.float64)]

    def load(self, q: torch.Tensor, qd: torch.Tensor, coefficients: Any) -> torch.Tensor:
        return super().load(q, qd, coefficients) * self.held[0]


class Masking(mt.TwoLinkArm):
    def load(self, q: torch.Tensor, qd: torch.Tensor, coefficients: Any) -> torch.Tensor:
        return super().load(q, qd, coefficients) + q[q > 0].sum()


class Single(mt.TwoLinkArm):
    def load(self, q: torch.Tensor, qd: torch.Tensor, coefficients: Any) -> torch.Tensor:
        return (super().load(q, qd, coefficients).float() * 2).double()


class Twice(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:
        return 2.0 * x

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> torch.Tensor:
        return 2.0 * gradient


class OldForm(mt.TwoLinkArm):
    def load(self, q: torch.Tensor, qd: torch.Tensor, coefficients: Any) -> torch.Tensor:
        return Twice.apply(super().load(q, qd, coefficients))


class Counting(mt.TwoLinkArm):
    count = 0

    def load(self, q: torch.Tensor, qd: torch.Tensor, coefficients: Any) -> torch.Tensor:
        self.count += 1
        return super().load(q, qd, coefficients) * (1.0 + 1e-3 * self.count)


@pytest.mark.parametrize(
    ("plant", "row"),
    [
        (Holding, 1),
        (Masking, 2),
        (Drawing, 3),
        (Spectral, 4),
        (Single, 5),
        (OldForm, 6),
        (Counting, 7),
    ],
)
def test_the_tables_words_are_the_reasons(plant: type[mt.Plant], row: int) -> None:
    loop = mt.ClosedLoop(plant(), make_loop("nn").controller)
    run = mt.rollout(loop, make_scenario(0.02))
    assert run.engine == "eager" and REASONS[row] in run.engine_reason, run.engine_reason
