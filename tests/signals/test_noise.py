"""Measurement noise: what its numbers are, and who shares them."""

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import noise_at
from tests.conftest import generator


def test_numbers_are_normal_white_and_of_the_stated_size() -> None:
    noise = mt.MeasurementNoise([1e-3, 1e-2], seed=[4, 5])
    n = 40_000
    added = noise_at(noise.table((2, 2), n), torch.arange(n))
    for part, std in zip(added.split(2, dim=-1), (1e-3, 1e-2), strict=True):
        assert part.shape == (n, 2, 2)
        assert torch.allclose(part.std(dim=0) / std, torch.ones(2, 2).double(), atol=0.02)
        assert (part.mean(dim=0).abs() < 5 * std / n**0.5).all()
        lagged = (part[1:] * part[:-1]).mean(dim=0) / std**2
        assert (lagged.abs() < 5 / n**0.5).all()
    flat = torch.cat([added[..., :2] / 1e-3, added[..., 2:] / 1e-2], dim=-1).reshape(n, -1)
    cross = torch.corrcoef(flat.T) - torch.eye(8)
    assert (cross.abs() < 5 / n**0.5).all()


def test_equal_seeds_share_their_noise_and_a_longer_run_begins_as_a_shorter_one() -> None:
    noise = mt.MeasurementNoise([1.0, 1.0], seed=torch.tensor([3, 8, 3]))
    table = noise.table((2, 2), 1001)
    assert len(table.unit) == 2
    added = noise_at(table, torch.arange(1001))
    assert torch.equal(added[:, 0], added[:, 2]) and not torch.equal(added[0], added[1])
    short = noise_at(noise.table((2, 2), 37), torch.arange(37))
    assert torch.equal(short, added[:37])
    alone = noise_at(noise.select([1]).table((2, 2), 37), torch.arange(37))
    assert torch.equal(alone[:, 0], short[:, 1])


def test_a_rate_holds_each_value() -> None:
    starts = torch.arange(1000, dtype=torch.float64) * 4e-3
    assert torch.equal(mt.MeasurementNoise([1.0, 1.0]).instants(starts), torch.arange(1000))
    held = mt.MeasurementNoise([1.0, 1.0], rate=50.0).instants(starts)
    assert torch.equal(held, torch.arange(1000) // 5)


@pytest.mark.parametrize(
    "arguments",
    [
        {"std": [-1.0, 0.0]},
        {"std": [0.0, float("nan")]},
        {"std": [0.0, 0.0], "seed": -1},
        {"std": [0.0, 0.0], "seed": 0.5},
        {"std": [0.0, 0.0], "rate": 0.0},
    ],
)
def test_bad_values_are_named_errors(arguments: dict[str, float]) -> None:
    with pytest.raises(mt.ConfigError, match="noise"):
        mt.MeasurementNoise(**arguments)  # type: ignore[arg-type]


def test_stacking_wants_one_rate_and_shapes_must_broadcast() -> None:
    with pytest.raises(mt.ConfigError):
        mt.MeasurementNoise.stack(
            [mt.MeasurementNoise([1.0, 1.0]), mt.MeasurementNoise([1.0, 1.0], rate=9.0)]
        )
    with pytest.raises(mt.ShapeError):
        mt.MeasurementNoise([[1.0, 1.0], [2.0, 1.0]], seed=[1, 2, 3])


def test_the_plant_is_not_disturbed_where_the_controller_ignores_its_sensors() -> None:
    """Without gains there is no way from the sensors to the plant."""
    controller = mt.MannController(
        2, 4, base_gain=1e-9, robust_gain=0.0, rate_W=1e-12, rate_V=1e-12
    )
    loop = mt.ClosedLoop(mt.TwoLinkArm(), controller)
    scenario = mt.Scenario(mt.Sinusoid([0.1, 0.1]), mt.arm_parameters(), horizon=0.2)
    noisy = mt.Scenario(
        mt.Sinusoid([0.1, 0.1]),
        mt.arm_parameters(),
        horizon=0.2,
        noise=mt.MeasurementNoise([1e-3, 1e-2]),
    )
    runs = [mt.rollout(loop, s, generator=generator(), engine="torch").q for s in (scenario, noisy)]
    assert torch.allclose(runs[0], runs[1], atol=1e-9) and not torch.equal(runs[0], runs[1])
