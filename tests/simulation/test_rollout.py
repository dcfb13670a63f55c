"""Rollouts: batches, jumps, diverging samples, gradients; every test on both engines."""

import functools
import math

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import Surroundings
from mann_torch.simulation import observe
from mann_torch.simulation.conditions import Conditions
from mann_torch.trees import map_tensors
from mann_torch.types import LoopMode, LoopState, NetworkState, PlantState
from tests.conftest import CONTROLLERS, generator, make_controller, make_loop, make_scenario


@pytest.fixture(params=["auto", "torch"], autouse=True)
def _engine(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """What `auto` takes is compiled, but for torchdiffeq's solvers."""
    monkeypatch.setattr(mt, "rollout", functools.partial(mt.rollout, engine=request.param))


@pytest.mark.parametrize("name", CONTROLLERS)
def test_batch_equals_single_runs(name: str) -> None:
    loop, scenario = make_loop(name), make_scenario(0.4, jumps=(0.2,))
    network = loop.controller.initial_weights((5,), generator())
    together = mt.rollout(loop, scenario, weights=network)
    for i in range(5):
        one = NetworkState(*(leaf[i] for leaf in network))
        alone = mt.rollout(loop, scenario, weights=one)
        torch.testing.assert_close(alone.q, together.q[:, i], rtol=0, atol=1e-12)
        mine = map_tensors(lambda leaf, i=i: leaf[:, i], together.states)
        map_tensors(
            lambda a, b: torch.testing.assert_close(a, b, rtol=0, atol=1e-12) or a,
            alone.states,
            mine,
        )


def test_stacked_scenarios_with_own_jumps_equal_single_ones() -> None:
    loop = make_loop("reallocating_initial")
    scenarios = [make_scenario(0.3, jumps=(0.1,)), make_scenario(0.4, jumps=(0.15, 0.25))]
    network = loop.controller.initial_weights((), generator())
    solver = mt.Implicit(5e-3)  # ends a step on every jump of both
    both = mt.rollout(loop, mt.Scenario.stack(scenarios), solver, weights=network, sample_dt=0.005)
    for i, scenario in enumerate(scenarios):
        alone = mt.rollout(loop, scenario, solver, weights=network)
        n = len(alone.t)
        torch.testing.assert_close(alone.q, both.q[:n, i], rtol=0, atol=1e-12)
        torch.testing.assert_close(mt.srmse(alone), mt.srmse(both)[i], rtol=1e-12, atol=0)


def test_a_jump_acts_from_its_very_time_on() -> None:
    loop = make_loop("nn")
    knot = 0.1 + 1e-4  # off the grid
    network = loop.controller.initial_weights((), generator())
    jump = mt.rollout(loop, make_scenario(0.3, jumps=(knot,)), weights=network)
    until = mt.rollout(loop, make_scenario(knot), weights=network)
    k = jump.t.tolist().index(knot)
    assert torch.equal(jump.q[: k + 1], until.q)  # the same bits up to the jump
    # From the knot on: a run that starts there with the new masses.
    heavy = mt.Scenario(
        mt.Sinusoid([1.0, 0.3], [0.5, 0.7], [0.0, 0.1]), mt.arm_parameters([1.12, 3.22]), knot
    )
    lone = mt.rollout(loop, heavy, weights=network)
    assert not torch.equal(lone.q, until.q)
    arm, t = loop.plant, jump.t[k]
    state = LoopState(
        PlantState(jump.q[k], jump.qd[k]),
        map_tensors(lambda leaf: leaf[-1], until.states.controller),
    )
    outside = Surroundings(heavy.reference)
    rates = [
        loop.flow(t, state, LoopMode(None), Conditions(outside, arm.coefficients(p)))[0].plant.qd
        for p in (mt.arm_parameters(), heavy.parameters)
    ]
    h = jump.t[k + 1] - t
    observed = (jump.qd[k + 1] - jump.qd[k]) / h
    assert (observed - rates[1]).norm() < 0.5 * (observed - rates[0]).norm()


def diverging_network(loop: mt.ClosedLoop, bad: int) -> NetworkState:
    network = loop.controller.initial_weights((4,), generator())
    W = torch.zeros_like(network.W)
    W[bad] = 1e9  # feeds itself beyond every bound within the first steps
    return network._replace(W=W)


@pytest.mark.parametrize("solver", [mt.Implicit(), mt.Odeint("rk4", dt=5e-3, max_step=2e-4)])
def test_a_diverging_sample_is_frozen_and_spares_its_mates(solver: mt.Solver) -> None:
    loop, scenario = make_loop("reallocating_initial"), make_scenario(0.05)
    with torch.no_grad():
        network = diverging_network(loop, bad=2)
        run = mt.rollout(loop, scenario, solver, weights=network)
        mates = mt.rollout(
            loop, scenario, solver, weights=NetworkState(*(leaf[[0, 1, 3]] for leaf in network))
        )
    assert run.status.tolist() == [0, 0, 1, 0]
    assert run.describe_status()[2].startswith("diverged at t = ")
    assert math.isfinite(float(run.stopped_at[2])) and bool(
        torch.isnan(run.stopped_at[[0, 1, 3]]).all()
    )
    torch.testing.assert_close(run.q[:, [0, 1, 3]], mates.q, rtol=0, atol=1e-12)
    assert bool(torch.isfinite(run.q).all())
    assert torch.isnan(mt.srmse(run)[2]).all() and torch.isfinite(mt.srmse(run)[[0, 1, 3]]).all()


@pytest.mark.parametrize("name", ["nn", "hard"])
def test_even_a_sample_that_dies_from_its_first_step_leaks_no_nan(name: str) -> None:
    loop, scenario = make_loop(name), make_scenario(0.01)
    loop.controller.initialize(robust_gain=[10.0, 1e9])  # far beyond what rk4 can step
    network = loop.controller.initial_weights((2,), generator())
    (gain,) = loop.controller.tune("base_gain")
    solver = mt.Odeint("rk4", dt=5e-3, max_step=2e-4)
    run = mt.rollout(loop, scenario, solver, weights=network)
    assert run.status.tolist() == [0, 1]
    (with_dead,) = torch.autograd.grad(run.error[:, 0].square().sum(), gain)
    loop.controller.initialize(robust_gain=10.0)
    (gain,) = loop.controller.tune("base_gain")
    alone = mt.rollout(loop, scenario, solver, weights=NetworkState(*(x[0] for x in network)))
    (without,) = torch.autograd.grad(alone.error.square().sum(), gain)
    torch.testing.assert_close(with_dead, without, rtol=1e-9, atol=0)


def test_after_a_death_an_adaptive_solver_does_no_extra_work() -> None:
    class Counting(mt.TwoLinkArm):
        calls = 0

        def mass_matrix(self, q, coefficients):
            Counting.calls += 1
            return super().mass_matrix(q, coefficients)

    loop = mt.ClosedLoop(Counting(), make_controller("nn"))
    network = loop.controller.initial_weights((2,), generator())
    W = torch.zeros_like(network.W)
    W[1] = 1e12
    counts = []
    with torch.no_grad():
        for horizon in (0.005, 0.03):
            Counting.calls = 0
            solver = mt.Odeint("dopri5", max_evaluations=500)
            scenario = make_scenario(horizon)
            run = mt.rollout(loop, scenario, solver, weights=network._replace(W=W))
            assert (run.status != 0).tolist() == [False, True]
            counts.append(Counting.calls)
    assert counts[1] - counts[0] < 500  # five steps of the healthy sample alone


def test_a_dead_sample_leaks_no_nan_into_shared_gradients() -> None:
    loop, scenario = make_loop("hard"), make_scenario(0.05)
    network = diverging_network(loop, bad=0)
    (gain,) = loop.controller.tune("write_gain")

    def gradient(rows: list[int]) -> torch.Tensor:
        chosen = NetworkState(*(leaf[rows] for leaf in network))
        error = mt.rollout(loop, scenario, weights=chosen).error
        alive = [k for k, row in enumerate(rows) if row != 0]
        return torch.autograd.grad(error[:, alive].square().sum(), gain)[0]

    torch.testing.assert_close(gradient([0, 1, 2, 3]), gradient([1, 2, 3]), rtol=1e-12, atol=0)


@pytest.mark.parametrize("name", [pytest.param("nn", marks=pytest.mark.slow), "soft"])
def test_gradients_of_smooth_loops_match_central_differences(name: str) -> None:
    loop, scenario = make_loop(name), make_scenario(0.5, jumps=(0.25,))
    controller = loop.controller
    network = controller.initial_weights((2,), generator())
    # The W-method treats its matrix as a constant of the step: order and limit are unaffected.
    constants = ["error_gain", "base_gain", "robust_gain", "rate_W", "rate_V", "e_modification"]
    constants += ["weight_bound"] + (["write_gain"] if name == "soft" else [])
    controller.initialize(e_modification=0.05, weight_bound=0.1)
    free = controller.tune(*constants)

    def loss() -> torch.Tensor:
        return mt.rollout(loop, scenario, weights=network).error.square().sum()

    gradients = torch.autograd.grad(loss(), free)
    for constant, gradient in zip(free, gradients, strict=True):
        value = constant.detach().clone()
        h = 1e-5 * value
        ends = []
        for sign in (1.0, -1.0):
            with torch.no_grad():
                constant.copy_(value + sign * h)
                ends.append(float(loss()))
                constant.copy_(value)
        directional = float((gradient * h).sum())
        assert (ends[0] - ends[1]) / 2 == pytest.approx(directional, rel=1e-6)


def test_gradients_reach_masses_lengths_reference_and_initial_weights() -> None:
    loop = make_loop("reallocating_initial")
    masses = torch.tensor([0.8, 2.3], dtype=torch.float64, requires_grad=True)
    lengths = torch.tensor([1.0, 1.0], dtype=torch.float64, requires_grad=True)
    amplitude = torch.tensor([1.0, 0.2], dtype=torch.float64, requires_grad=True)
    network = loop.controller.initial_weights((), generator())
    network = network._replace(V=network.V.clone().requires_grad_())
    scenario = mt.Scenario(mt.Sinusoid(amplitude), mt.arm_parameters(masses, lengths), 0.2)
    run = mt.rollout(loop, scenario, weights=network)
    wanted = [masses, lengths, amplitude, network.V]
    for gradient in torch.autograd.grad(mt.srmse(run).sum(), wanted):
        assert bool(torch.isfinite(gradient).all()) and bool((gradient != 0).any())


def test_memory_state_is_not_touched_by_a_rollout() -> None:
    loop = make_loop("reallocating_always")
    before = {k: v.clone() for k, v in loop.state_dict().items()}
    mt.rollout(loop, make_scenario(0.2), generator=generator())
    assert all(torch.equal(v, before[k]) for k, v in loop.state_dict().items())


def test_same_seed_gives_the_same_bits() -> None:
    loop, scenario = make_loop("reallocating_always"), make_scenario(0.5)
    a, b = (mt.rollout(loop, scenario, generator=generator(3), batch_shape=(2,)) for _ in range(2))
    assert torch.equal(a.q, b.q) and torch.equal(a.modes.attended, b.modes.attended)


def test_reallocating_counts_and_signals_are_recorded() -> None:
    loop, scenario = make_loop("reallocating_initial", n_slots=3), make_scenario(2.0)
    run = mt.rollout(loop, scenario, generator=generator(), sample_dt=0.01)
    assert int(mt.reallocations(run)) == int(run.final_mode.active.sum()) - 1 > 0
    out = observe(loop, scenario, run)
    picked = out.signals.weights.argmax(-1)
    kept = run.states.controller.memory.mu
    read = kept[torch.arange(len(picked)), picked]
    torch.testing.assert_close(out.signals.read, read, rtol=0, atol=0)
    torch.testing.assert_close(
        out.signals.tracking.error, scenario.reference(run.sample_t).value - run.states.plant.q
    )


def test_srmse_is_the_root_mean_square_over_samples() -> None:
    run = mt.rollout(make_loop("nn"), make_scenario(0.5), generator=generator())
    expected = run.error.square().mean(dim=0).sqrt()
    torch.testing.assert_close(mt.srmse(run), expected, rtol=1e-12, atol=0)
    late = run.error[run.t > 0.3].square().mean(dim=0).sqrt()
    torch.testing.assert_close(mt.srmse(run, after=0.3), late, rtol=1e-12, atol=0)


def test_shapes_that_do_not_fit_are_named() -> None:
    loop, scenario = make_loop("nn"), mt.Scenario.stack([make_scenario(), make_scenario()])
    with pytest.raises(mt.ShapeError, match="broadcast"):
        mt.rollout(loop, scenario, weights=loop.controller.initial_weights((3,), generator()))
    with pytest.raises(mt.ConfigError, match="horizon"):
        make_scenario(float("nan"))
    with pytest.raises(mt.ConfigError, match="schedule of 'mass'"):
        schedule = {"mass": mt.PiecewiseConstant([1.0], [[1.0], [2.0]])}
        mt.Scenario(mt.Sinusoid([1.0, 0.0]), mt.arm_parameters(), 1.0, schedule)


def test_batched_scenarios_stack_row_by_row() -> None:
    loop = make_loop("nn")
    network = loop.controller.initial_weights((), generator())
    masses = torch.tensor([[0.8, 2.3], [1.6, 3.0]], dtype=torch.float64)
    one = mt.Scenario(mt.Sinusoid([1.0, 0.0]), mt.arm_parameters(masses), 0.1)
    two = mt.Scenario(mt.Sinusoid([0.2, 0.5]), mt.arm_parameters(masses, [1.0, 2.0]), 0.1)
    both = mt.rollout(loop, mt.Scenario.stack([one, two]), weights=network)
    for i, scenario in enumerate((one, two)):
        alone = mt.rollout(loop, scenario, weights=network)
        torch.testing.assert_close(both.q[:, i], alone.q, rtol=0, atol=1e-12)
    with pytest.raises(mt.ConfigError, match="same batch shape"):
        mt.Scenario.stack([one, make_scenario()])


def test_batched_constants_give_the_rollout_its_batch() -> None:
    loop = make_loop("reallocating_initial")
    loop.controller.initialize(base_gain=[10.0, 20.0, 30.0], write_gain=[0.5, 0.75, 1.0])
    run = mt.rollout(loop, make_scenario(0.05))
    assert run.q.shape[1:] == (3, 2) and run.status.tolist() == [0, 0, 0]
    with pytest.raises(mt.ShapeError, match="constants"):
        mt.rollout(loop, make_scenario(0.05), batch_shape=(4,))


def test_strong_friction_is_stepped_implicitly() -> None:
    loop = make_loop("soft")
    rough = mt.arm_parameters(viscous=[200.0, 200.0], coulomb=[20.0, 20.0])
    scenario = mt.Scenario(mt.Sinusoid([1.0, 0.3]), rough, 0.5)
    runs = [mt.rollout(loop, scenario, mt.Implicit(dt)) for dt in (5e-3, 2.5e-4)]
    assert runs[0].status.item() == 0
    torch.testing.assert_close(mt.srmse(runs[0]), mt.srmse(runs[1]), rtol=0.02, atol=0)


def test_a_stored_memory_starts_the_next_rollout_with_its_slots() -> None:
    loop, scenario = make_loop("reallocating_initial", n_slots=4), make_scenario(1.0)
    first = mt.rollout(loop, scenario)
    memory = loop.controller.memory
    state = map_tensors(lambda leaf: leaf[-1], first.states.controller.memory)
    memory.store_(state, first.final_mode.active)
    second = mt.rollout(loop, make_scenario(0.005))
    assert torch.equal(second.modes.active[0], first.final_mode.active)
    assert torch.equal(second.states.controller.memory.mu[0], state.mu)


def test_srmse_later_than_a_samples_own_horizon_is_nan_without_poisoning_gradients() -> None:
    loop = make_loop("nn")
    scenario = mt.Scenario.stack([make_scenario(0.02), make_scenario(0.05)])
    (gain,) = loop.controller.tune("base_gain")
    late = mt.srmse(mt.rollout(loop, scenario), after=0.03)
    assert torch.isnan(late[0]).all() and torch.isfinite(late[1]).all()
    (gradient,) = torch.autograd.grad(late.nanmean(), gain)
    assert bool(torch.isfinite(gradient))


NOWHERE = torch.full((2,), math.nan, dtype=torch.float64)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schedule": {"masses": mt.PiecewiseConstant([0.01], [[0.8, 2.3], [-0.8, 2.3]])}}, "mass"),
        ({"schedule": {"masses": mt.PiecewiseConstant([0.01], [[1.0], [2.0]])}}, "masses"),
        ({"schedule": {"masses": ([0.01], [[0.8, 2.3]])}}, "PiecewiseConstant"),
        ({"start": PlantState(torch.zeros(3).double(), torch.zeros(3).double())}, "start"),
        (
            {"start": PlantState(torch.full((2,), math.nan).double(), torch.zeros(2).double())},
            "start",
        ),
        ({"weights": "V of 9 inputs"}, "initial V"),
        ({"weights": "float32"}, "float32"),
        ({"weights": "nan"}, "not all numbers are finite"),
        ({"batch_shape": 8}, "batch_shape"),
        ({"divergence_limit": math.nan}, "divergence_limit"),
        ({"sample_until": -1.0}, "sample_until"),
        ({"sample_dt": 0.0}, "sample_dt"),
    ],
)
def test_what_does_not_fit_is_a_named_error(change: dict, words: str) -> None:
    loop = make_loop("soft")
    good = loop.controller.initial_weights((), generator())
    networks = {
        "V of 9 inputs": good._replace(V=good.V[:9]),
        "float32": good._replace(V=good.V.float()),
        "nan": good._replace(b_v=good.b_v * math.nan),
    }
    parts = {key: value for key, value in change.items() if key in ("schedule", "start")}
    change = {key: value for key, value in change.items() if key not in parts}
    if "weights" in change:
        change = {"weights": networks[change["weights"]]}
    with pytest.raises(mt.ConfigError, match=words):
        scenario = mt.Scenario(mt.Sinusoid([1.0, 0.0]), mt.arm_parameters(), 0.02, **parts)
        mt.rollout(loop, scenario, **change)
