"""The estimator says what it lacks."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConcurrentLearning, Estimator, FreezeWhileSaturated
from mann_torch.errors import ConfigError, ShapeError
from mann_torch.plants import LinearPlant, Regression
from mann_torch.signals import Polynomial


def test_an_estimator_refuses_what_it_cannot_give() -> None:
    with pytest.raises(ConfigError, match="needs excess of a drive"):
        Estimator(AdaptiveLaw(FreezeWhileSaturated()))
    with pytest.raises(ConfigError, match="of r = 2, this controller's have r = 1"):
        Estimator(AdaptiveLaw(ConcurrentLearning(rows=2)))
    with pytest.raises(ShapeError, match="start of shape"):
        Estimator(start=[1.0, 2.0])
    plant = LinearPlant([[-1.0]], [[1.0]], [[1.0]])
    scenario = mt.Scenario(Polynomial([[0.0]]), plant.parameters_of(), 1.0)
    with pytest.raises(ConfigError, match="features = 'phi' is no field of the measurement: y"):
        mt.rollout(mt.ClosedLoop(plant, Estimator()), scenario)


def test_a_start_of_another_size_is_named_and_a_right_one_is_kept() -> None:
    plant = Regression()
    scenario = mt.Scenario(Polynomial([[0.0]]), plant.parameters_of(), 0.1)
    with pytest.raises(ShapeError, match=r"start of shape \(3, 1\): \(N, m\) = \(2, 1\) are seen"):
        mt.rollout(mt.ClosedLoop(plant, Estimator(start=[[1.0], [2.0], [3.0]])), scenario)
    # Started where it is sought, it predicts all there is, and nothing moves.
    loop = mt.ClosedLoop(plant, Estimator(start=[[1.0], [2.0]]))
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(0.01), engine="torch")
    assert float(run.output.abs().max()) <= 1e-15
    torch.testing.assert_close(
        run.states.controller.theta[-1, :, 0], torch.tensor([1.0, 2.0]).double()
    )
