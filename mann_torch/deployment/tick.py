"""What a deployed controller does at one instant, as one torch module: every runtime's source."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ..control import Controller
from ..control.sampling import moved
from ..functional import pick
from ..parts import Actuator, ReferenceModel
from ..trees import leaves, map_tensors, portable
from ..types import ControllerTree, Mode, ReferenceSample
from .ports import Ports

#: Bits of the flags of a tick: something that came in is not finite, and nothing was done; the
#: command is at a limit; what would come out is not finite, and nothing was done.
REFUSED, SATURATED, DIVERGED = 1, 2, 4


@portable
class Kept(NamedTuple):
    """What a deployed controller keeps from tick to tick."""

    input: Tensor  # (m,) in force
    controller: ControllerTree
    mode: Mode
    rates: ControllerTree  # of the controller's state at the last tick
    decay: ControllerTree  # how fast that forgets, at the last tick
    begun: Tensor  # () bool, whether there was a tick
    model: Tensor | None  # (d,) state of the reference model
    model_rates: Tensor | None  # (d,)


class Ticked(NamedTuple):
    """What a tick gives."""

    input: Tensor  # (m,)
    kept: Kept
    flags: Tensor  # () int64


class Tick(nn.Module):
    """Measure, adapt over the period, decide, command: the instant of a `Clock`, without a loop.

    The controller's state moves as under `Clock` (`mann_torch.control.sampling`), a reference
    model's by Heun's rule. `adapt` () <= 0.5 holds what adapts (`Controller.held`). Where something
    that comes in is not finite, or would not be, all that is kept and the command stay.
    """

    def __init__(
        self,
        controller: Controller,
        period: float,
        ports: Ports,
        model: ReferenceModel | None,
        actuator: Actuator | None,
    ) -> None:
        super().__init__()
        self.controller, self.period, self.ports = controller, period, ports
        self.model, self.actuator = model, actuator

    def start(
        self,
        reference: Tensor,
        measurement: Tensor,
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> Kept:
        """What there is before the first tick, of what there is then: (R,) and (Y,)."""
        command, seen = self.ports.sample(reference), self.ports.seen(measurement)
        state = rates = None
        if self.model is not None:
            y = self._output(measurement)
            state = self.model.initial_state(command, y)
            rates = torch.zeros_like(state)
            command = self.model.sample(command, y, state)
        own, mode = self.controller.initial_state(command, seen, (), generator, weights)
        answer = self.controller(command, seen, own, mode)
        nothing = torch.zeros_like(answer.input)
        return Kept(
            input=nothing if self.actuator is None else self.actuator.saturated(nothing),
            controller=own,
            mode=mode,
            rates=map_tensors(torch.zeros_like, own),
            decay=map_tensors(torch.zeros_like, answer.decay),
            begun=torch.zeros((), dtype=torch.bool),
            model=state,
            model_rates=rates,
        )

    def forward(self, reference: Tensor, measurement: Tensor, adapt: Tensor, kept: Kept) -> Ticked:
        """One tick, at a reference (R,), a measurement (Y,) and `adapt` () above or below 0.5."""
        given = torch.cat([reference, measurement])
        good = torch.isfinite(given).all()
        learns = adapt > 0.5
        seen = self.ports.seen(measurement)
        sample, model, model_rates = self._followed(reference, measurement, kept)
        own, mode = self._adapted(sample, seen, kept, learns)
        answer = self.controller(sample, seen, own, mode)
        wanted = u = answer.input
        if self.actuator is not None:
            u = self.actuator.saturated(wanted)
        made = Kept(
            u, own, mode, answer.d_state, answer.decay, torch.ones_like(kept.begun), model,
            model_rates,
        )  # fmt: skip
        numbers = [x.reshape(-1) for x in leaves(made) if x.is_floating_point()]
        finite = torch.isfinite(torch.cat(numbers)).all()
        done = good & finite
        after = map_tensors(lambda new, old: pick(done, new, old), made, kept)
        saturated = done & (u != wanted).any()
        flags = torch.where(good, torch.where(finite, 0, DIVERGED), REFUSED)
        return Ticked(after.input, after, flags + saturated.to(torch.int64) * SATURATED)

    def _output(self, measurement: Tensor) -> Tensor:
        """The plant's output (p,), of what is measured."""
        places = self.ports.output
        return torch.stack([measurement[i] for i in places or ()])

    def _elapsed(self, kept: Kept) -> Tensor:
        """Time since the last tick () [s]: the period, 0 before the first."""
        return kept.begun.to(kept.input.dtype) * self.period

    def _followed(
        self, reference: Tensor, measurement: Tensor, kept: Kept
    ) -> tuple[ReferenceSample, Tensor | None, Tensor | None]:
        """What the controller follows, and the reference model's state and rates."""
        sample = self.ports.sample(reference)
        if self.model is None or kept.model is None or kept.model_rates is None:
            return sample, None, None
        y, time = self._output(measurement), self._elapsed(kept)
        trial = kept.model + time * kept.model_rates
        rates = self.model.rates(sample, y, trial)
        state = kept.model + 0.5 * time * (kept.model_rates + rates)
        return self.model.sample(sample, y, state), state, self.model.rates(sample, y, state)

    def _adapted(
        self, sample: ReferenceSample, seen: Any, kept: Kept, learns: Tensor
    ) -> tuple[ControllerTree, Mode]:
        """The controller's state and mode at this instant, after its decisions."""
        controller, before, mode = self.controller, kept.controller, kept.mode
        own = moved(
            controller, self._elapsed(kept), sample, seen, before, mode, kept.rates, kept.decay
        )
        own = self._held(learns, before, own)
        if mode is None:  # as in a loop
            return own, None
        decided, then = controller.jump(sample, seen, own, mode)
        return self._held(learns, own, decided), _chosen(learns, then, mode)

    def _held(self, learns: Tensor, before: ControllerTree, after: ControllerTree) -> Any:
        """The state after, but for what adapts where nothing is to be learned."""
        if after is None:
            return None
        return _chosen(learns, after, self.controller.held(before, after))


def _chosen(condition: Tensor, new: Any, old: Any) -> Any:
    """`new` where the condition () holds, else `old`; what is the same needs no choice."""
    return map_tensors(lambda a, b: a if a is b else torch.where(condition, a, b), new, old)
