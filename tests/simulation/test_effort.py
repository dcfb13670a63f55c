"""Measurement noise in the loop, and what the torque costs."""

import dataclasses

import pytest
import torch

import mann_torch as mt
from tests.simulation.loops import Case, case, freed

ENGINES = ("torch", "compiled")


def noisy(name: str, horizon: float = 0.12, rate: float | None = None) -> Case:
    made = case(name, horizon)
    noise = mt.MeasurementNoise(
        [[1e-3, 1e-2], [2e-3, 1e-2], [0.0, 1e-2]], seed=[5, 6, 5], rate=rate
    )
    return made._replace(scenario=dataclasses.replace(made.scenario, noise=noise))


def run(made: Case, **options: object) -> mt.Trajectory:
    return mt.rollout(made.loop, made.scenario, weights=made.weights, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("engine", ENGINES)
def test_effort_is_that_of_the_torques_the_controller_gave(engine: str) -> None:
    made = noisy("hard_state_keys", rate=100.0)
    with torch.no_grad():
        trajectory = run(made, engine=engine, effort_after=0.05, sample_dt=1e-5)
        # Decisions fall at a step's start, before the torque.
        starts = trajectory.sample_t[:-1]
        shifted = dataclasses.replace(
            trajectory,
            modes=type(trajectory.modes)(
                *(
                    None if leaf is None else torch.cat([leaf[1:], leaf[-1:]])
                    for leaf in trajectory.modes
                )
            ),
        )
        torque = mt.observe(made.loop, made.scenario, shifted).input[:-1]
    steps = starts.diff()
    rate = torque.diff(dim=0) / steps[:, None, None]
    mean = (rate.square() * steps[:, None, None]).sum(dim=0) / steps.sum()
    assert torch.allclose(mt.input_rate(trajectory), mean.sqrt(), rtol=1e-9)
    late = torque[starts > 0.05 + 1e-9].abs().amax(dim=0)
    assert torch.allclose(mt.peak_input(trajectory), late, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "gradient"),
    [
        ("nn", "plain"),
        ("reallocating_always_state_keys", "plain"),
        ("reallocating_initial", "hybrid"),
    ],
)
def test_both_engines_agree_with_noise_effort_and_gradients(name: str, gradient: str) -> None:
    found = []
    for engine in ENGINES:
        made, free = freed(noisy(name))
        trajectory = run(made, engine=engine, effort_after=0.03, gradient=gradient)
        assert (trajectory.engine == "compiled") == (engine == "compiled")
        parts = (
            mt.srmse(trajectory),
            1e-4 * mt.input_rate(trajectory),
            mt.peak_input(trajectory),
        )
        sum(part.sum() for part in parts).backward()  # type: ignore[union-attr]
        found.append((trajectory.q, *parts, *(leaf.grad for leaf in free.values())))
    for mine, other in zip(*found, strict=True):
        assert (mine is None) == (other is None)
        if mine is not None and mine.numel():
            assert float((mine - other).abs().max()) <= 1e-9 * float(mine.abs().max())


def test_a_shorter_horizon_counts_no_later_torque() -> None:
    made = case("nn", 0.2)
    horizon = torch.tensor([0.2, 0.1, 0.2], dtype=torch.float64)
    mixed = made._replace(scenario=dataclasses.replace(made.scenario, horizon=horizon))
    short = made._replace(scenario=dataclasses.replace(made.scenario, horizon=0.1))
    for engine in ENGINES:
        with torch.no_grad():
            both = run(mixed, engine=engine, effort_after=0.02)
            one = run(short, engine=engine, effort_after=0.02)
        for metric in (mt.input_rate, mt.peak_input):
            assert torch.allclose(metric(both)[1], metric(one)[1], rtol=1e-6)
        assert not torch.allclose(mt.input_rate(both)[0], mt.input_rate(one)[0], rtol=1e-3)


def test_a_sample_in_a_batch_has_the_noise_it_has_alone() -> None:
    made = noisy("hard", rate=None)
    chosen = made.scenario.select([1])
    network = type(made.weights)(*(leaf[[1]] for leaf in made.weights))
    with torch.no_grad():
        whole = run(made, effort_after=0.0)
        alone = mt.rollout(made.loop, chosen, weights=network, effort_after=0.0)
    assert torch.allclose(whole.q[:, 1], alone.q[:, 0], rtol=1e-12, atol=1e-14)
    assert torch.allclose(mt.input_rate(whole)[1], mt.input_rate(alone)[0], rtol=1e-10)


def test_effort_must_be_asked_for_and_makes_sense() -> None:
    made = case("nn", 0.02)
    with pytest.raises(mt.ConfigError, match="effort_after"):
        mt.input_rate(run(made))
    with pytest.raises(mt.ConfigError, match="effort_after"):
        run(made, effort_after=-1.0)
