"""Shared builders. Every test is seeded and runs torch on one thread."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from tests.away import AWAY, NEEDS_CHECKOUT

collect_ignore = list(NEEDS_CHECKOUT) if AWAY else []
GOLDEN = Path(__file__).parent / "golden"
CONTROLLERS = (
    "nn",
    "soft",
    "hard",
    "hard_state_keys",
    "reallocating_initial",
    "reallocating_initial_state_keys",
    "reallocating_always",
)


#: Cases, by their ids, that only `make check` takes.
SLOW_CASES = Path(__file__).parent / "slow_cases.txt"


def pytest_configure(config: pytest.Config) -> None:
    for line in ("slow: minutes long", "checkout: reads or runs what no wheel has"):
        config.addinivalue_line("markers", line)  # away there is no pyproject.toml that says so


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    slow = set(SLOW_CASES.read_text().splitlines())
    for item in items:
        if item.nodeid in slow:
            item.add_marker(pytest.mark.slow)
    # The longest goes first: at the end one process would wait for it alone.
    items.sort(key=lambda item: not item.nodeid.startswith("tests/site/test_site.py"))
    for item in items if AWAY else ():
        if item.get_closest_marker("checkout"):
            item.add_marker(pytest.mark.skip(reason="needs the checkout"))


@pytest.fixture(autouse=True)
def _one_thread_and_seed() -> None:
    torch.set_num_threads(1)
    torch.manual_seed(0)


ATTENTION_MAKERS: dict[str, Callable[[], mt.Attention]] = {
    "soft": mt.SoftAttention,
    "hard": mt.HardAttention,
    "reallocating_initial": lambda: mt.ReallocatingAttention("initial"),
    "reallocating_always": lambda: mt.ReallocatingAttention("always"),
    "relaxed_hard": lambda: mt.RelaxedAttention(0.05),
    "relaxed_initial": lambda: mt.RelaxedAttention(0.05, "initial"),
    "relaxed_always": lambda: mt.RelaxedAttention(0.05, "always"),
}


def make_attention(name: str) -> mt.Attention:
    return ATTENTION_MAKERS[name]()


def make_controller(name: str, n_hidden: int = 6, n_slots: int = 4) -> mt.MannController:
    if name == "nn":
        return mt.MannController(2, n_hidden)
    attention = make_attention(name.removesuffix("_state_keys"))
    rule = mt.StateKeys() if name.endswith("state_keys") else mt.RepresentationKeys()
    memory = mt.WorkingMemory(n_slots, n_hidden, attention, rule, context_width=2)
    return mt.MannController(2, n_hidden, memory)


def make_loop(name: str, **sizes: int) -> mt.ClosedLoop:
    return mt.ClosedLoop(mt.TwoLinkArm(), make_controller(name, **sizes))


def make_scenario(horizon: float = 0.5, jumps: tuple[float, ...] = ()) -> mt.Scenario:
    masses = torch.tensor([[0.8 * 1.4**k, 2.3 * 1.4**k] for k in range(len(jumps) + 1)]).double()
    times = torch.tensor(jumps, dtype=torch.float64)
    return mt.Scenario(
        reference=mt.Sinusoid([1.0, 0.3], [0.5, 0.7], [0.0, 0.1]),
        parameters=mt.arm_parameters(),
        horizon=horizon,
        schedule={"masses": mt.PiecewiseConstant(times, masses)},
    )


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def randn(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(*shape, generator=generator(seed), dtype=torch.float64)
