"""Gradients of the compiled engine: against torch's, against differences, and through segments."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.types import NetworkState
from tests.conftest import make_loop
from tests.simulation.loops import NAMES, Case, case, freed
from tests.simulation.test_compiled_parity import configured


def loss_of(run: mt.Trajectory) -> Tensor:
    """A number that every output of a rollout enters."""
    states = run.states
    loss = mt.srmse(run).sum() + 0.1 * run.q.square().mean() + 0.01 * run.qd.square().mean()
    loss = loss + run.squared_error[len(run.t) // 2].sum()
    for leaf in (*states.plant, *states.controller.network):
        loss = loss + 0.1 * leaf[1:].square().mean() + 0.1 * leaf[0].mean()
    memory = states.controller.memory
    if memory is not None:
        loss = loss + memory.mu.square().mean() + 0.1 * memory.keys.sum()
        loss = loss + 0.1 * (run.modes.active[1:] * 1.0).square().mean()
    return loss


def gradients(made: Case, free: dict[str, Tensor], **options: object) -> dict[str, Tensor]:
    loss = loss_of(made.run(sample_dt=0.1, **options))
    found = torch.autograd.grad(loss, list(free.values()), allow_unused=True)
    return {name: g for name, g in zip(free, found, strict=True) if g is not None}


#: The others are minutes of compiling: `make check`.
QUICK = ("soft", "reallocating_always_state_keys")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_equal_to_torch_autograd_over_two_seconds(name: str) -> None:
    made, free = freed(case(name, 2.0, batch=2))
    expected, found = (gradients(made, free, engine=engine) for engine in ("torch", "compiled"))
    assert found.keys() == expected.keys() == free.keys()
    for key, gradient in expected.items():
        assert gradient.norm() > 0, key
        # A temperature of 0.04 lets rounding grow: 1.07e-11 was seen for one controller of six.
        limit = 2e-11 if name.startswith("relaxed") else 1e-11
        assert float((found[key] - gradient).norm() / gradient.norm()) <= limit, key


@pytest.mark.parametrize("name", QUICK)
def test_segments_and_threads_give_the_same_bits(name: str) -> None:
    made, free = freed(case(name, 0.5))
    whole = gradients(made, free, engine="compiled")
    state = 8 * 3 * 200  # bytes of a step of the batch, and more
    for steps in (2, 7, 50):
        pieces = gradients(made, free, engine="compiled", tape_memory=2.0 * state * steps)
        assert all(torch.equal(pieces[key], whole[key]) for key in whole)
    torch.set_num_threads(2)
    spread = gradients(made, free, engine="compiled")
    for key, gradient in whole.items():
        torch.testing.assert_close(spread[key], gradient, rtol=1e-12, atol=0)


@pytest.mark.slow
def test_constants_per_sample_have_gradients_of_their_own() -> None:
    made = case("soft", 0.3, batch=3)
    values = torch.tensor([0.5, 0.7, 0.9], dtype=torch.float64)
    made.loop.controller.initialize(write_gain=values)
    (gain,) = made.loop.controller.tune("write_gain")
    loss = mt.srmse(made.run(engine="compiled")).sum(dim=-1)
    (together,) = torch.autograd.grad(loss.sum(), gain)
    start = made.scenario.start
    assert start is not None
    for i in range(3):
        made.loop.controller.initialize(write_gain=values[i])
        (gain,) = made.loop.controller.tune("write_gain")
        alone = made._replace(weights=NetworkState(*(leaf[i] for leaf in made.weights)))
        row = type(start)(*(leaf[i] for leaf in start))
        object.__setattr__(made.scenario, "start", row)
        (own,) = torch.autograd.grad(mt.srmse(alone.run(engine="compiled")).sum(), gain)
        object.__setattr__(made.scenario, "start", start)
        torch.testing.assert_close(together[i], own, rtol=1e-12, atol=0)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["nn", "soft"])
def test_equal_to_central_differences_over_330_s(controller: str) -> None:
    """Elasticities of the SRMSE in scenario 1, by Richardson's rule from one batch."""
    made = configured(f"controller={controller}", "constants.e_modification=0.01")
    network = NetworkState(*(leaf[0] for leaf in made.weights))
    design = made.loop.controller
    names = ["error_gain", "base_gain", "robust_gain", "rate_W", "rate_V", "e_modification"]
    names += ["write_gain"] if controller == "soft" else []
    values = {name: design.constant(name).detach().clone() for name in names}

    def loss() -> Tensor:
        run = mt.rollout(
            made.loop,
            made.scenario,
            weights=network,
            engine="compiled",
            motion_dt=1.0,
            sample_until=0.0,
        )
        return mt.srmse(run).sum(dim=-1)

    free = design.tune(*names)
    found = torch.autograd.grad(loss(), free)
    slopes = torch.stack(
        [(g * value).sum() for g, value in zip(found, values.values(), strict=True)]
    )
    h, factors = 3e-4, (1, -1, 2, -2)
    design.initialize(
        **{
            name: torch.stack(
                [value * (1 + k * h * (name == moved)) for moved in names for k in factors]
            )
            for name, value in values.items()
        }
    )
    with torch.no_grad():
        ends = loss().reshape(-1, 4)
    near, far = (ends[:, 0] - ends[:, 1]) / 2, (ends[:, 2] - ends[:, 3]) / 4
    torch.testing.assert_close(slopes, (4 * near - far) / (3 * h), rtol=1e-6, atol=0)


@pytest.mark.parametrize("name", ["hard", "relaxed_always_state_keys"])
def test_a_dead_sample_leaks_no_nan_and_its_mates_keep_their_gradient(name: str) -> None:
    made, free = freed(case(name, 0.1, batch=3))
    W = made.weights.W.detach().clone()
    W[1] = 1e9
    made = made._replace(weights=made.weights._replace(W=W))
    run = made.run(engine="compiled")
    assert run.status[1] != 0
    names = ("base_gain", "error_gain", "masses", "lengths", "amplitude")
    found = torch.autograd.grad(run.q[:, [0, 2]].square().sum(), [free[n] for n in names])
    reference = torch.autograd.grad(
        made.run(engine="torch").q[:, [0, 2]].square().sum(), [free[n] for n in names]
    )
    for gradient, expected in zip(found, reference, strict=True):
        torch.testing.assert_close(gradient, expected, rtol=1e-9, atol=0)


def test_a_constant_changed_before_backward_leaves_the_gradient_of_what_was_run() -> None:
    found = []
    for factor in (1.0, 2.0):
        made = case("nn", 0.02)
        (gain,) = made.loop.controller.tune("error_gain")
        loss = mt.srmse(made.run(engine="compiled")).sum()
        with torch.no_grad():
            gain.mul_(factor)
        found.append(torch.autograd.grad(loss, gain)[0])
    assert torch.equal(found[0], found[1])


def test_a_second_backward_gives_the_same_bits_and_no_tape_is_kept() -> None:
    made, free = freed(case("soft", 0.2))
    loss = loss_of(made.run(sample_dt=0.1, engine="compiled"))
    first, second = (
        torch.autograd.grad(loss, list(free.values()), retain_graph=True, allow_unused=True)
        for _ in range(2)
    )
    for a, b in zip(first, second, strict=True):
        assert (a is None and b is None) or torch.equal(a, b)


def test_a_perfect_stretch_has_error_and_gradient_zero() -> None:
    loop = make_loop("nn")
    still = mt.Scenario(mt.Sinusoid([0.0, 0.0]), mt.arm_parameters(), 0.1)
    (gain,) = loop.controller.tune("base_gain")
    loop.plant.gravity = 0.0
    for engine in ("torch", "compiled"):
        run = mt.rollout(loop, still, weights=rest(loop), engine=engine)
        for after in (None, 0.05):
            found = mt.srmse(run, after)
            (slope,) = torch.autograd.grad(found.sum(), gain, retain_graph=True)
            assert found.tolist() == [0.0, 0.0] and float(slope) == 0.0


def rest(loop: mt.ClosedLoop) -> NetworkState:
    """All weights 0: no torque where there is no error."""
    network = loop.controller.initial_weights(())
    return NetworkState(*(torch.zeros_like(leaf) for leaf in network))


def test_a_second_derivative_is_refused_by_name() -> None:
    made = case("nn", 0.02)
    (gain,) = made.loop.controller.tune("base_gain")
    loss = mt.srmse(made.run(engine="compiled")).sum()
    (first,) = torch.autograd.grad(loss, gain, create_graph=True)
    with pytest.raises(mt.KernelError, match="first derivatives only"):
        first.backward()
    with pytest.raises(mt.KernelError, match="first derivatives only"):  # this way too
        torch.autograd.grad(first, gain)
