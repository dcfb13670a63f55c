"""Problem 4 (Chowdhary and Johnson 2010): wing rock, and learning from stored data."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control
from mann_torch.plants import CHOWDHARY_JOHNSON, RowState, WingRock
from mann_torch.signals import Steps

MODEL, INPUT = [[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]]
#: When the command rises to 1, or falls to 0 [s].
EDGES = [5.0, 10.0, 20.0, 25.0, 35.0, 40.0, 50.0]


def features(z: Tensor) -> Tensor:
    """phi of x alone, which comes first."""
    return WingRock.basis(z[..., :2])


def wing(
    *parts: control.LawPart,
    labels: control.Labels | None = None,
    horizon: float = 60.0,
    dt: float = 1e-3,
    engine: str = "compiled",
) -> mt.Trajectory:
    """x_m'' = (r - x_m) - x_m', u = that + 1.2 (e + e') - W^' phi, W^ at a rate of 10."""
    plant = WingRock(accelerometer=isinstance(labels, control.MeasuredLabels))
    law = control.AdaptiveLaw(control.ConstantGain(10.0), *parts)
    network = control.LinearNetwork(control.FunctionBasis(features, 3, 6), 1, law)
    controller = control.Mrac.of_model(
        MODEL,
        INPUT,
        network,
        feedback=[[1.0, 1.0]],
        feedforward=[[1.0]],
        error_feedback=[[0.2, 0.2]],
        labels=labels,
    )
    model = mt.LinearModel(MODEL, INPUT, [[1.0, 0.0]], start=[2.0, 2.0])
    values = [[float(k % 2)] for k in range(len(EDGES) + 1)]
    start = RowState(torch.tensor([2.0, 2.0], dtype=torch.float64))
    scenario = mt.Scenario(Steps(EDGES, values), plant.parameters_of(), horizon, start=start)
    loop = mt.ClosedLoop(plant, controller, model=model)
    with torch.no_grad():
        return mt.rollout(loop, scenario, mt.RungeKutta(dt), sample_dt=10.0, engine=engine)


def distances(run: mt.Trajectory) -> Tensor:
    """|W^ - W*| each 10 s: what is sought cancels the moment."""
    sought = -torch.tensor(CHOWDHARY_JOHNSON, dtype=torch.float64)
    gap: Tensor = run.states.controller.adaptive.network.W[..., 0] - sought
    return gap.norm(dim=-1)


def test_the_error_gain_is_the_problems() -> None:
    """P = [[17/12, 5/12], [5/12, 0.7638889]], of A_m - B K_e."""
    network = control.LinearNetwork(control.Identity(3), 1)
    made = control.Mrac.of_model(MODEL, INPUT, network, error_feedback=[[0.2, 0.2]])
    assert made.constant("error_gain").tolist() == pytest.approx([5 / 12, 55 / 72], rel=1e-14)


def test_mrac_alone_learns_little() -> None:
    found = distances(wing())
    assert found[[1, 6]].tolist() == pytest.approx([0.97933, 0.91703], abs=5.1e-6)


def learning() -> control.ConcurrentLearning:
    """20 points, at 0.5, 1, ..., 10 s, each in use from then on, at 10 * 0.05 = 0.5."""
    return control.ConcurrentLearning(0.05, size=20, period=0.5)


def test_stored_data_teach_it() -> None:
    found = distances(wing(learning(), labels=control.MeasuredLabels("moment")))
    assert float(found[1]) == pytest.approx(0.13729, abs=5.1e-6)
    assert float(found[6]) == pytest.approx(2.03e-6, abs=5.1e-9)


@pytest.mark.slow
def test_so_do_filters_that_measure_no_acceleration() -> None:
    labels = control.FilteredLabels([[0.0, 1.0], [0.0, 0.0]], INPUT, 20.0)
    assert float(distances(wing(learning(), labels=labels))[6]) < 1e-5


@pytest.mark.slow
def test_the_torch_engine_finds_the_same() -> None:
    plain = wing(horizon=10.0, engine="torch")
    assert float(distances(plain)[1]) == pytest.approx(0.97933, abs=5.1e-6)
    labels = control.MeasuredLabels("moment")
    learned = wing(learning(), labels=labels, horizon=10.0, engine="torch")
    assert float(distances(learned)[1]) == pytest.approx(0.13729, abs=5.1e-6)
