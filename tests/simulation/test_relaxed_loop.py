"""Rollouts of relaxed controllers: their limit, and their gradients against differences."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch.trees import leaves
from tests.conftest import generator, make_loop, make_scenario
from tests.simulation.loops import case

HARD = ("hard_state_keys", "reallocating_initial", "reallocating_always_state_keys")


@pytest.mark.parametrize("name", HARD)
def test_the_limit_is_the_hard_controller_and_the_error_falls(name: str) -> None:
    made = case(name, 0.3)
    temperatures = torch.tensor([3e-1, 1e-2, 1e-7], dtype=torch.float64).unsqueeze(-1)
    soft = made._replace(loop=mt.relaxed(made.loop, temperatures))
    with torch.no_grad():
        expected, found = made.run(), soft.run()
    assert found.engine == "compiled" and found.q.shape[1:] == (3, 3, 2)
    errors = (found.q - expected.q.unsqueeze(1)).square().mean(dim=(0, 2, 3)).sqrt().tolist()
    assert errors[0] > errors[1] > errors[2]
    for a, b in zip(leaves(expected.states), leaves(found.states), strict=True):
        torch.testing.assert_close(b[:, -1], a, rtol=0, atol=1e-9)
    for count in (mt.reallocations, mt.switches):
        assert torch.equal(count(found)[-1], count(expected))
    active = expected.final_mode.active.double()
    torch.testing.assert_close(found.final_mode.active[-1], active, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["hard", "reallocating_always"])
def test_the_limit_from_slots_that_start_equal(name: str) -> None:
    loop, runs = make_loop(name), []
    with torch.no_grad():
        for each in (loop, mt.relaxed(loop, 1e-7)):
            runs.append(mt.rollout(each, make_scenario(0.3), generator=generator(), engine="torch"))
    for a, b in zip(*(leaves(run.states) for run in runs), strict=True):
        torch.testing.assert_close(b, a, rtol=0, atol=1e-9)
    assert torch.equal(*(mt.reallocations(run) for run in runs))


@pytest.mark.parametrize(
    "name", ["relaxed_hard_state_keys", "relaxed_initial", "relaxed_always_state_keys"]
)
def test_gradients_equal_central_differences(name: str) -> None:
    """Elasticities in every constant, by Richardson's rule from one batch, on the torch engine."""
    made = case(name, 0.3, batch=2)
    design = made.loop.controller
    values = {key: value.detach().clone() for key, value in design.constants().items()}

    def loss() -> torch.Tensor:
        run = made.run(engine="torch")
        mu = run.states.controller.memory.mu
        return (mt.srmse(run).sum(dim=-1) + mu.square().mean(dim=(0, -2, -1))).sum(dim=-1)

    free = design.tune(*values)
    found = torch.autograd.grad(loss(), free)
    slopes = torch.stack([(g * v).sum() for g, v in zip(found, values.values(), strict=True)])
    h, factors = 1e-5, (1, -1, 2, -2)
    design.initialize(
        **{
            key: torch.stack(
                [value * (1 + k * h * (key == moved)) for moved in values for k in factors]
            ).unsqueeze(1)
            for key, value in values.items()
        }
    )
    with torch.no_grad():
        ends = loss().reshape(-1, 4)
    near, far = (ends[:, 0] - ends[:, 1]) / 2, (ends[:, 2] - ends[:, 3]) / 4
    torch.testing.assert_close(slopes, (4 * near - far) / (3 * h), rtol=1e-6, atol=1e-9)
    assert bool((slopes != 0).all())


@pytest.mark.slow
def test_theta_has_a_gradient_where_distances_come_near_it() -> None:
    made = case("reallocating_always", 0.2)
    (theta,) = made.loop.controller.tune("shift_threshold")
    hard = mt.srmse(made.run()).sum()
    assert not hard.requires_grad or torch.autograd.grad(hard, theta)[0] == 0
    soft = made._replace(loop=mt.relaxed(made.loop, 0.03))
    mt.srmse(soft.run()).sum().backward()
    assert theta.grad is not None and float(theta.grad.abs()) > 1e-6
    made.loop.controller.initialize(shift_threshold=50.0)
    (theta,) = made.loop.controller.tune("shift_threshold")
    soft = made._replace(loop=mt.relaxed(made.loop, 0.03))
    (slope,) = torch.autograd.grad(mt.srmse(soft.run()).sum(), theta)
    assert float(slope) == 0.0


@pytest.mark.slow
def test_constants_per_sample_are_each_samples_own() -> None:
    made = case("reallocating_always", 0.2, batch=1)
    T, theta = torch.tensor([[0.02, 0.05], [0.12, 0.2]], dtype=torch.float64).unsqueeze(-1)
    T.requires_grad_()
    made.loop.controller.initialize(shift_threshold=theta)
    together = made._replace(loop=mt.relaxed(made.loop, T)).run()
    (slope,) = torch.autograd.grad(together.q.square().sum(), T)
    for i in range(2):
        made.loop.controller.initialize(shift_threshold=theta[i])
        own = T[i].detach().requires_grad_()
        alone = made._replace(loop=mt.relaxed(made.loop, own)).run()
        torch.testing.assert_close(alone.q, together.q[:, i], rtol=1e-12, atol=1e-14)
        (found,) = torch.autograd.grad(alone.q.square().sum(), own)
        torch.testing.assert_close(found, slope[i], rtol=1e-10, atol=0)


@pytest.mark.parametrize(
    "name", [pytest.param("hard", marks=pytest.mark.slow), "reallocating_always"]
)
def test_a_fresh_memory_whose_slots_are_all_alike_is_compiled_with_its_gradient(name: str) -> None:
    """At t = 0 the derivative hangs on rounding; a step later it does not."""
    loop = make_loop(name)
    (gain,) = loop.controller.tune("error_gain")
    run = mt.rollout(
        loop, make_scenario(0.1), gradient="soft", temperature=0.05, generator=generator()
    )
    assert run.engine == "compiled", run.engine_reason
    (slope,) = torch.autograd.grad(mt.srmse(run).sum(), gain)
    assert bool(torch.isfinite(slope).all()) and bool((slope.diagonal() != 0).all())
