"""Readouts: a slot's law, what attends it, Lyapunov's ledger, and where they cannot be."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control
from mann_torch.control import Drive, Readouts
from mann_torch.errors import ConfigError, DomainError, KindError
from mann_torch.plants import LinearPlant
from tests.conftest import make_scenario, randn

B, N, m, S = 4, 5, 2, 3
N_INPUTS = 3
GAIN = 7.0


def approximator(**settings: Any) -> control.Approximator:
    """Of a network whose law is dW/dt = 7 sigma r', so that the proof is exact."""
    law = control.AdaptiveLaw(control.ConstantGain(GAIN))
    network = control.LinearNetwork(control.RadialBasis.scattered(N_INPUTS, N, 2.0), m, law)
    return control.Approximator(network, None, ("shortfall",), Readouts(S, **settings))


def at_random(
    made: control.Approximator, shortfall: Tensor
) -> tuple[Any, Any, Any, Tensor, Tensor]:
    """State, what is found there and its rates, at any weights and any misses."""
    x, r = randn(B, N_INPUTS, seed=1), randn(B, m, seed=2)
    state, mode = made.initial_state(x, x, (B,))
    held = state.readouts.held._replace(W=randn(B, S, N, m, seed=3))
    readouts = state.readouts._replace(held=held, misses=randn(B, S, seed=4).square() + 0.1)
    own = state.network._replace(W=randn(B, N, m, seed=5))
    state = state._replace(network=own, readouts=readouts)
    found = made(x, r, x, state, mode)
    drive = Drive.of_features(found.features.hidden, r, r.norm(dim=-1), shortfall=shortfall)
    return state, found, made.rates(found, drive, state, mode), x, r


def inner(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).flatten(1).sum(dim=1)


@pytest.mark.parametrize("common", [0.0, 0.3, 1.0])
def test_lyapunovs_function_falls_as_the_plain_networks_whatever_is_attended(common: float) -> None:
    made = approximator(common=common)
    state, found, rates, _, r = at_random(made, torch.zeros(B, m).double())
    true = randn(N, m, seed=6)
    own, held = state.network.W, state.readouts.held.W
    if common == 0.0:  # W stands still: as the weights add to 1, each slot seeks what W lacks
        wrong = held - (true - own).unsqueeze(1)
        d_errors = inner(wrong, rates.readouts.held.W) / GAIN
    else:
        d_errors = -inner(true - own, rates.network.W) / (common * GAIN)
        d_errors = d_errors + inner(held, rates.readouts.held.W) / GAIN
    f = found.features.hidden @ true
    # M dr/dt = f - f^ - K r, so that r' M dr/dt + d_errors = -r' K r
    torch.testing.assert_close(d_errors, -inner(r, f - found.output), rtol=1e-12, atol=1e-12)


def test_a_slots_error_is_that_of_its_own_readout_on_what_was_needed() -> None:
    short = randn(B, m, seed=7)
    made = approximator(recall_time=0.2)
    state, found, rates, *_ = at_random(made, short)
    needed = found.output + short
    for i in range(S):
        own = state.network.W + state.readouts.held.W[:, i]
        said = (found.features.hidden.unsqueeze(-2) @ own).squeeze(-2)
        squared = (needed - said).square().sum(-1)
        torch.testing.assert_close(
            rates.readouts.misses[:, i], (squared - state.readouts.misses[:, i]) / 0.2
        )


def test_the_least_error_has_the_most_weight_and_others_stand_still() -> None:
    made = approximator(sharpness=60.0)
    state, found, rates, *_ = at_random(made, torch.zeros(B, m).double())
    best = state.readouts.misses.argmin(dim=1)
    assert torch.equal(found.weights.argmax(dim=1), best)
    moved = rates.readouts.held.W.flatten(2).norm(dim=2)
    far = state.readouts.misses > 3.0 * state.readouts.misses.amin(dim=1, keepdim=True)
    assert bool(far.any())
    assert bool((moved[far] < 1e-25).all())
    assert bool((moved.gather(1, best.unsqueeze(1)) > 1.0).all())


def test_weights_are_powers_of_errors() -> None:
    misses = torch.tensor([[1.0, 2.0, 4.0]], dtype=torch.float64)
    found = Readouts(3, sharpness=2.0).weights(control.ReadoutState(None, misses))
    wanted = torch.tensor([[16.0, 4.0, 1.0]], dtype=torch.float64) / 21.0
    torch.testing.assert_close(found, wanted, rtol=1e-5, atol=0.0)


def test_slots_differ_at_first_and_a_batch_has_the_same_ones() -> None:
    made = approximator(spread=0.5)
    state, _ = made.initial_state(randn(B, N_INPUTS), randn(B, N_INPUTS), (B,))
    held = state.readouts.held.W
    assert bool((held[:, 0] == 0.0).all())
    assert torch.equal(held[1:], held[:1].expand(B - 1, -1, -1, -1))
    assert 0.2 < float(held[0, 1:].std()) < 0.9
    assert not torch.equal(held[0, 1], held[0, 2])


def arm(readouts: Readouts | None, rate_W: float = 10.0, memory: Any = None) -> mt.ClosedLoop:
    controller = mt.MannController(2, 4, memory, rate_W=rate_W, readouts=readouts)
    return mt.ClosedLoop(mt.TwoLinkArm(), controller)


def run(loop: mt.ClosedLoop, horizon: float = 0.06, **settings: Any) -> mt.Trajectory:
    torch.manual_seed(0)
    weights = mt.MannController(2, 4).network.initial_state((), torch.Generator().manual_seed(0))
    settings = {"engine": "torch", **settings}
    return mt.rollout(
        loop, make_scenario(horizon), mt.RungeKutta(2e-3), weights=weights, **settings
    )


@pytest.mark.parametrize("common", [0.0, 1.0])
def test_one_slot_is_the_plain_network_faster_by_what_is_common(common: float) -> None:
    """W + M_1 is moved by (c + 1) C_w."""
    found = run(arm(Readouts(1, common=common)))
    plain = run(arm(None, rate_W=10.0 * (1.0 + common)))
    torch.testing.assert_close(found.error, plain.error, rtol=0.0, atol=1e-12)
    assert float(found.error.abs().amax()) > 0.01


def test_samples_with_constants_of_their_own_are_runs_of_their_own() -> None:
    times = [0.01, 0.1]
    together = run(arm(Readouts(2, recall_time=times, spread=0.5)))
    for i, tau in enumerate(times):
        alone = run(arm(Readouts(2, recall_time=tau, spread=0.5)))
        torch.testing.assert_close(together.error[:, i], alone.error, rtol=0.0, atol=1e-12)
    assert not torch.equal(together.error[:, 0], together.error[:, 1])


@pytest.mark.parametrize(
    "memory", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["alone", "with a memory"]
)
def test_both_engines_agree_in_numbers_and_in_gradients(memory: bool) -> None:
    found = {}
    for engine in ("torch", "compiled"):
        slots = mt.WorkingMemory(2, 4, mt.HardAttention()) if memory else None
        loop = arm(Readouts(2, spread=0.5, common=0.5), memory=slots)
        freed = loop.controller.tune("recall_time", "sharpness", "common", "rate_W")
        ran = run(loop, engine=engine)
        ran.squared_error[-1].sum().backward()
        found[engine] = [ran.error.detach(), *(p.grad for p in freed)]
    for one, other in zip(*found.values(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-10, atol=1e-14)
        assert bool((one != 0.0).any())


def test_gradients_reach_its_constants() -> None:
    loop = arm(Readouts(2, spread=0.5, common=0.5))
    names = ("recall_time", "sharpness", "common")
    freed = loop.controller.tune(*names)
    run(loop, 0.02).squared_error[-1].sum().backward()
    for name, constant in zip(names, freed, strict=True):
        assert constant.grad is not None and float(constant.grad.abs()) > 0.0, name


@pytest.mark.parametrize("known", [True, False])
def test_labels_judge_them_in_mrac(known: bool) -> None:
    """Of x'' = u - 3 x + 2 x': where W is that already, E falls by e^(-t / tau), else it does not.

    Filters that start with what they filter give exact labels from the first instant on.
    """
    unknown = [[-3.0], [2.0], [0.0]]  # of x, x', r
    A, B = [[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]]
    law = control.AdaptiveLaw(control.ConstantGain(1e-3))
    network = control.LinearNetwork(
        control.Identity(3), 1, law, start=[[-row[0]] for row in unknown] if known else 0.0
    )
    made = control.Mrac.of_model(
        A, B, network, feedforward=[[1.0]], labels=control.FilteredLabels(A, B, 20.0),
        readouts=Readouts(2, recall_time=0.1, spread=0.0),
    )  # fmt: skip
    plant = LinearPlant([[0.0, 1.0], [-4.0, 0.0]], B, [[1.0, 0.0]], measured="state")
    loop = mt.ClosedLoop(plant, made, model=mt.LinearModel(A, B, [[1.0, 0.0]]))
    scenario = mt.Scenario(mt.Sinusoid([1.0], 2.0), plant.parameters_of(), 0.5, start=plant.rest())
    ran = mt.rollout(loop, scenario, mt.RungeKutta(2e-3), engine="torch")
    misses = ran.states.controller.adaptive.readouts.misses[-1]
    fallen = torch.full((2,), -5.0).double().exp()
    if known:
        torch.testing.assert_close(misses, fallen, rtol=1e-6, atol=1e-6)
    else:
        assert bool((misses > fallen + 1e-2).all())


def test_what_cannot_be_judged_or_held_is_refused() -> None:
    network = control.LinearNetwork(control.Identity(3), 1)
    with pytest.raises(ConfigError, match="nothing to tell: give it labels"):
        control.Approximator(network, readouts=Readouts(2))
    network.outer = ()
    with pytest.raises(ConfigError, match="LinearNetwork does not say what W is"):
        control.Approximator(network, None, ("pair",), Readouts(2))
    with pytest.raises(KindError, match="readouts = 3"):
        control.Approximator(network, None, ("pair",), 3)  # type: ignore[arg-type]
    for name in ("recall_time", "sharpness"):
        with pytest.raises(DomainError, match=name):
            Readouts(2, **{name: 0.0})
    with pytest.raises(DomainError, match="common"):
        Readouts(2, common=-0.1)
    with pytest.raises(ConfigError, match="spread"):
        Readouts(2, spread=-0.1)
    with pytest.raises(ConfigError, match="n_slots"):
        Readouts(0)
