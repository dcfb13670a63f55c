"""docs/write/law.md does what it says: its code runs as printed, and its table is whole."""

import re
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

import mann_torch as mt
from mann_torch.control import LAW_PARTS, LAWS, AdaptiveLaw, ConstantGain, Drive
from mann_torch.control.mann import MannController
from tests.pages import executed, text_of

PAGE = text_of("write/law.md")


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    return executed("write/law.md")


def test_the_table_has_every_mechanism_and_law_with_its_constants() -> None:
    rows = [
        line for line in PAGE.split("## All there is")[1].splitlines() if line.startswith("| `")
    ]
    told = {re.findall(r"`(\w+)`", row)[0]: row for row in rows}
    known = {kind.__name__: kind for kind in (*LAW_PARTS.values(), *LAWS.values())}
    assert set(told) == set(known) - {"AdaptiveLaw"}
    for name, row in told.items():
        arguments = {"gain_bound": 1.0, "reset_at": 0.1} if name == "LeastSquares" else {}
        for constant in known[name](**arguments).constants():
            assert f"`{constant}`" in row


def test_the_composed_law_finds_what_is_sought(page: dict[str, Any]) -> None:
    assert page["theta"].tolist() == pytest.approx([1.0, 2.0], abs=1e-2)
    for slope in (page["forgetting"].grad, page["learning"].grad):
        assert bool(torch.isfinite(slope).all() and (slope != 0).all())


def test_a_leak_costs_error_and_its_slope_says_so(page: dict[str, Any]) -> None:
    error = mt.srmse(page["leaky"]).sum(-1)
    assert bool((error[1:] > error[:-1]).all())
    assert bool((page["leak"].grad > 0).all())


def test_a_fading_gain_fades_and_is_a_constant_one_where_it_does_not(page: dict[str, Any]) -> None:
    run = page["faded"]
    share = run.states.controller.laws.gain.share[..., 0, 0]
    rates = torch.tensor([0.0, 0.1, 0.5], dtype=torch.float64)
    known = torch.exp(-rates * run.sample_t.unsqueeze(-1))
    order = (4e-3) ** 2 * 0.5**3 * 10.0 / 6.0  # h^2 rate^3 t / 6: what Heun's method is off by
    torch.testing.assert_close(share, known, rtol=1.1 * order, atol=0.0)
    assert bool((page["fading"].grad > 0).all())
    plain = mt.srmse(page["leaky"])[0]  # by a constant gain, and no leak
    torch.testing.assert_close(mt.srmse(run)[0], plain, rtol=1e-12, atol=0.0)


def test_ones_own_mechanism_at_zero_is_none(page: dict[str, Any]) -> None:
    generator = torch.Generator().manual_seed(0)
    phi, s, theta = (
        torch.randn(*shape, generator=generator, dtype=torch.float64)
        for shape in ((5, 4), (5, 3), (5, 4, 3))
    )
    drive = Drive.of_features(phi, s, s.norm(dim=-1))
    plain = AdaptiveLaw(ConstantGain(2.0))(drive, theta, None)[0]
    own = [AdaptiveLaw(ConstantGain(2.0), page["GrowingLeak"](c)) for c in (0.0, 0.3)]
    assert torch.equal(own[0](drive, theta, None)[0], plain)
    pulled = own[1](drive, theta, None)[0] - plain
    known = -2.0 * 0.3 * theta.square().sum(dim=-2, keepdim=True) * theta
    torch.testing.assert_close(pulled, known, rtol=1e-9, atol=1e-12)


def test_its_file_is_of_the_form_that_is_read(page: dict[str, Any]) -> None:
    (text,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.S)
    node = OmegaConf.to_container(OmegaConf.create(text))
    assert isinstance(node, dict) and node.pop("name") == "adaptive"
    parts = {**LAW_PARTS, "growing_leak": page["GrowingLeak"]}
    law = AdaptiveLaw(*(parts[name](**told) for name, told in node.items()))
    assert set(law.constants()) == {"adaptation_rate", "growing_leak"}


def test_law_and_memory_are_where_the_page_puts_them(page: dict[str, Any]) -> None:
    made = MannController(2, memory=page["memory"], network=page["linear"])
    assert {"initial_gain", "forgetting", "gain_bound", "write_gain"} <= set(made.constants())
    P = page["beside"].states.controller.laws.gain.P
    assert P.shape[-2:] == (12, 12)
    assert torch.linalg.eigvalsh(P[-1]).min() > 0 and P[-1].norm() < 100.0
    constants = MannController(2, network=page["network"]).constants()
    assert {"adaptation_rate", "switching_sigma", "rate_V"} <= set(constants)
