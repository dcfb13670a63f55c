"""Run a closed loop through a scenario: jump, flow, record; split at every parameter jump."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from ..errors import ConfigError, ShapeError
from ..functional import as_float64
from ..trees import Packer, map_tensors
from ..types import NetworkState
from .closed_loop import ClosedLoop
from .implicit import Implicit
from .scenario import Scenario
from .solver import Solver
from .step_grid import StepGrid
from .stepping import Carry, Stepper
from .trajectory import Status, Trajectory


def rollout(
    loop: ClosedLoop,
    scenario: Scenario,
    solver: Solver | None = None,
    *,
    network: NetworkState | None = None,
    generator: torch.Generator | None = None,
    batch_shape: Sequence[int] = (),
    sample_dt: float = 0.05,
    sample_until: float | None = None,
    divergence_limit: float = 1e8,
    progress: Callable[[int], object] | None = None,
) -> Trajectory:
    """Integrate the loop over the scenario and record it.

    The loop alternates jump (reallocation, at the start of every step) and flow; steps end
    exactly on parameter jumps. Autograd runs through the whole rollout wherever something
    requires grad; under `torch.no_grad()` no graph is kept.

    Args:
        loop: plant and controller.
        scenario: what to do, batched or not.
        solver: `Implicit(dt=5e-3)` if not given.
        network: initial adaptive weights, each leaf (..., *event). If not given: random with
            `generator`, one draw a sample, else the controller's own.
        generator: source of random initial weights.
        batch_shape: batch shape of the initial weights; it must broadcast with those of the
            scenario and of the controller's constants.
        sample_dt: interval [s] at which whole states are kept; joint motion is kept every step.
        sample_until: time [s] after which no whole states are kept.
        divergence_limit: a sample with a state entry beyond this, or NaN, is frozen there and
            reported in `status`; the others go on undisturbed.
        progress: called with the number of steps done since the last call.

    Raises:
        ConfigError: a setting is out of range, DomainError if it is a constant or a parameter of
            the plant. ShapeError: sizes do not fit or batch shapes do not broadcast.
    """
    solver = Implicit() if solver is None else solver
    grid = StepGrid(scenario.end, scenario.knots(), solver.dt)
    if not divergence_limit > 0:
        raise ConfigError(f"divergence_limit = {divergence_limit}: must be > 0")
    if network is not None and (generator is not None or batch_shape != ()):
        raise ConfigError("give initial weights as `network`, or generator and batch_shape")
    if network is None:
        shape = _common_shape(loop, scenario, batch_shape)
        network = loop.controller.initial_network(shape, generator)
    state, mode = loop.initial_state(scenario, network)
    batch = state.plant.q.shape[:-1]
    n = state.plant.q.shape[-1]
    reference = scenario.reference.expand(batch)
    packer = Packer(state, len(batch))
    y = packer.pack(state)
    stepper = Stepper(loop, solver, packer, divergence_limit)
    carry = Carry(y, mode, torch.ones(batch, dtype=torch.bool))
    safe = y.detach()
    stopped_at = torch.full(batch, torch.nan, dtype=torch.float64)
    sampled = set(grid.samples(sample_dt, sample_until))
    motion, kept = [y[..., : 2 * n].clone()], [carry] if 0 in sampled else []
    times, sizes = grid.times.unbind(), grid.times.diff().unbind()
    n_alive, done = carry.alive.numel(), 0
    for segment in grid.segments:
        lookup = torch.tensor(segment.lookup, dtype=torch.float64)
        coefficients = loop.plant.coefficients(scenario.parameters_at(lookup))
        for k in range(segment.first, segment.last):
            arguments = (reference, coefficients)
            before = carry
            if n_alive == before.alive.numel():
                carry = stepper(times[k], sizes[k], before, *arguments)
            if n_alive < before.alive.numel() or not bool(carry.alive.all()):
                carry = stepper.without_dead(times[k], sizes[k], before, safe, *arguments)
                fell = before.alive & ~carry.alive
                stopped_at = torch.where(fell, times[k], stopped_at)
                n_alive = int(carry.alive.sum())
            motion.append(carry.y[..., : 2 * n].clone())
            if k + 1 in sampled:
                kept.append(carry)
            done += 1
            if progress is not None and done % 100 == 0:
                progress(100)
            if n_alive == 0:
                break
        if n_alive == 0:
            break
    if progress is not None:
        progress(done % 100)
    track = torch.stack(motion)
    t = grid.times[: len(motion)]
    index = [k for k in sorted(sampled) if k <= done]
    modes = [c.mode for c in kept]
    return Trajectory(
        t=t,
        q=track[..., :n],
        qd=track[..., n:],
        reference=reference(t),
        horizon=as_float64(scenario.horizon).expand(batch),
        sample_t=grid.times[index],
        states=packer.unpack(torch.stack([c.y for c in kept])),
        modes=map_tensors(lambda *leaf: torch.stack(leaf), *modes),
        final_mode=carry.mode,
        status=torch.where(carry.alive, int(Status.OK), int(Status.DIVERGED)),
        stopped_at=stopped_at,
        solver=solver.name,
        engine=stepper.engine,
    )


def _common_shape(loop: ClosedLoop, scenario: Scenario, extra: Sequence[int]) -> torch.Size:
    shapes = (scenario.batch_shape, loop.controller.batch_shape(), extra)
    try:
        return torch.broadcast_shapes(*(tuple(shape) for shape in shapes))
    except (RuntimeError, TypeError):
        raise ShapeError(
            f"batch shapes of scenario {tuple(shapes[0])}, constants {tuple(shapes[1])} and "
            f"batch_shape = {extra} do not broadcast"
        ) from None
