"""The loop's own parts of a configuration, each None where it is not chosen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from mann_torch import MeasurementNoise
from mann_torch.checks import whole
from mann_torch.errors import ConfigError
from mann_torch.parts import MODELS, Actuator, Clock, ReferenceModel, Sensor
from mann_torch.plants import Plant

from ..settings.config import LoopConfig
from .made import arguments, kind_of, made, mapping, unknown

_NOISE = ("std", "rate", "seed")


def build_parts(cfg: LoopConfig, plant: Plant) -> dict[str, Any]:
    """Actuator, sensor, clock and reference model, as `ClosedLoop` takes them.

    Raises `ConfigError`.
    """
    sampling = mapping("sensor", cfg.sensor)
    sampling.pop("noise", None)
    sizes = {"n_inputs": len(plant.inputs)}
    return {
        "actuator": _part("actuator", Actuator, mapping("actuator", cfg.actuator), sizes),
        "sensor": _part("sensor", Sensor, sampling, {}),
        "clock": _part("clock", Clock, mapping("clock", cfg.clock), {}),
        "model": _model(cfg, plant),
    }


def _part(where: str, kind: type, node: dict[str, Any], sizes: dict[str, Any]) -> Any:
    given = arguments(where, node, ("name",))
    return made(where, kind, given, sizes) if given else None


def _model(cfg: LoopConfig, plant: Plant) -> ReferenceModel | None:
    node = mapping("model", cfg.model)
    if not node:
        return None
    _, kind = kind_of("model", MODELS, node)
    width = {"width": len(plant.outputs)}
    model: ReferenceModel = made("model", kind, arguments("model", node), width)
    return model


def build_noise(cfg: LoopConfig, draws: Sequence[int]) -> MeasurementNoise | None:
    """Noise of the sensor, a stream a draw: draw k has number seed + k. Raises `ConfigError`."""
    node = mapping("sensor.noise", mapping("sensor", cfg.sensor).get("noise"))
    given = arguments("sensor.noise", node, ())
    for name in given:
        if name not in _NOISE:
            raise unknown("sensor.noise", name, "noise", _NOISE)
    if not given:
        return None
    first = whole("sensor.noise.seed", given.pop("seed", 1000), least=0)
    noise: MeasurementNoise = made("sensor.noise", MeasurementNoise, given, {"seed": first})
    if not bool(noise.std.any()):
        return None
    if noise.std.dim() != 1:
        raise ConfigError("sensor.noise.std: give one row, a number a field or a number of it")
    if first >= 1 << 62:
        raise ConfigError(f"sensor.noise.seed = {first}: must be < 2^62")
    seeds = torch.tensor([first + draw for draw in draws])
    return MeasurementNoise(noise.std.expand(len(draws), -1), seeds, noise.rate)
