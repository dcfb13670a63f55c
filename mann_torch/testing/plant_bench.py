"""What a plant is checked with: random states, inputs and parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import wrong
from ..errors import ShapeError
from ..functional import Numbers, as_float64
from ..plants import Plant
from ..trees import leaves, map_tensors, rebuilt
from .forms import called, is_tree
from .functions import SAMPLES
from .telling import broken


class Bench(NamedTuple):
    """A plant and a batch of arguments of its equations, all different."""

    plant: Plant
    parameters: Any  # fields (SAMPLES, d)
    t: Tensor  # (SAMPLES,)
    state: Any  # fields (SAMPLES, d)
    u: Tensor  # (SAMPLES, m)
    disturbance: Tensor | None  # (SAMPLES, k)

    @property
    def coefficients(self) -> Any:
        """Of all samples' parameters."""
        found = called(
            self.plant,
            4,
            "coefficients of parameters (..., d)",
            lambda: self.plant.coefficients(self.parameters),
        )
        if not is_tree(found):
            raise broken(
                self.plant,
                4,
                "coefficients are no NamedTuple of tensors",
                "the equations may need tensors (..., *) only, and None for what is absent",
            )
        return found

    def derivative(self) -> Any:
        """Of all samples."""
        return self.plant.derivative(
            self.t, self.state, self.plant.grouped(self.u), self.disturbance, self.coefficients
        )

    def sample(self, i: int) -> Bench:
        """One sample, without a batch dimension."""
        pick: Callable[[Tensor], Tensor] = lambda leaf: leaf[i]  # noqa: E731
        wind = None if self.disturbance is None else self.disturbance[i]
        return Bench(
            self.plant,
            map_tensors(pick, self.parameters),
            self.t[i],
            map_tensors(pick, self.state),
            self.u[i],
            wind,
        )

    def arguments(self) -> list[Tensor]:
        """State, input, parameters and disturbance, one after the other."""
        wind = [] if self.disturbance is None else [self.disturbance]
        return [*leaves(self.state), self.u, *leaves(self.parameters), *wind]

    def of(self, arguments: Sequence[Tensor]) -> Bench:
        """The same with other `arguments`."""
        rest = list(arguments)
        state = rebuilt(self.state, [rest.pop(0) for _ in leaves(self.state)])
        u = rest.pop(0)
        parameters = rebuilt(self.parameters, [rest.pop(0) for _ in leaves(self.parameters)])
        return self._replace(
            state=state, u=u, parameters=parameters, disturbance=rest[0] if rest else None
        )


def bench(plant: Plant, parameters: Any, states: Any) -> Bench:
    """Random arguments, always the same. States are drawn about `rest` unless they are given."""
    generator = torch.Generator().manual_seed(0)

    def draw(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    def near(row: Tensor) -> Tensor:
        # A hundredth: still in a parameter's domain.
        return row * (1.0 + 0.01 * draw(SAMPLES, row.shape[-1]).clamp(-3.0, 3.0))

    if states is None:
        states = map_tensors(lambda row: row + draw(SAMPLES, len(row)), plant.rest())
    else:
        states = _given(plant, states)
    wind = draw(SAMPLES, len(plant.disturbances)) if plant.disturbances else None
    u = draw(SAMPLES, len(plant.inputs))
    t = 10.0 * draw(SAMPLES).abs()
    return Bench(plant, map_tensors(near, parameters), t, states, u, wind)


def _given(plant: Plant, states: Any) -> Any:
    """States of a caller's, a row a sample."""
    rest = plant.rest()
    if type(states) is not type(rest):
        raise wrong("states", states, f"a {type(rest).__name__} of rows ({SAMPLES}, d)")

    def rows(row: Tensor, of: Numbers) -> Tensor:
        found = as_float64(of, "states")
        if found.shape not in ((SAMPLES, len(row)), (len(row),)):
            raise ShapeError(
                f"states have a field {tuple(found.shape)}: give ({SAMPLES}, {len(row)})"
            )
        return found.expand(SAMPLES, len(row)).clone()

    return map_tensors(rows, rest, states)
