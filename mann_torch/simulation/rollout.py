"""Run a closed loop through a scenario: jump, flow, record; split at every parameter jump."""

from __future__ import annotations

import dataclasses
import functools
import logging
from collections.abc import Callable, Sequence
from typing import Any

import torch

from ..checks import ABOVE_0, NONNEGATIVE, choice, function, instance, maybe, number, sizes, text
from ..compiled import UntraceableError
from ..errors import ConfigError, KernelError
from ..functional import Numbers
from ..memory import relaxed
from ..trees import leaf_names, leaves
from ..types import Snapshot
from .closed_loop import ClosedLoop
from .engines import compiled_engine, torch_engine
from .gradients import check_gradient, locates_events
from .outputs import outputs_of, plant_states
from .scenario import Scenario
from .solvers.implicit import Implicit
from .solvers.solver import Solver
from .task import Record, Task, grid_of, task_of
from .trajectory import Trajectory

ENGINES = ("auto", "compiled", "torch")
#: Steps beyond which the torch engine takes long enough to be told of.
LONG = 500
log = logging.getLogger("mann_torch")


def rollout(
    loop: ClosedLoop,
    scenario: Scenario,
    solver: Solver | None = None,
    *,
    weights: Any = None,
    generator: torch.Generator | None = None,
    batch_shape: Sequence[int] = (),
    begin: Snapshot | None = None,
    sample_dt: float = 0.05,
    sample_until: float | None = None,
    motion_dt: float | None = None,
    effort_after: float | None = None,
    divergence_limit: float = 1e8,
    engine: str = "auto",
    device: str = "cpu",
    tape_memory: float = 256e6,
    gradient: str = "plain",
    temperature: Numbers | None = None,
    progress: Callable[[int], object] | None = None,
) -> Trajectory:
    """Integrate the loop over the scenario and record it.

    The loop alternates jump (reallocation, at the start of every step) and flow; steps end
    exactly on parameter jumps. Autograd runs through the whole rollout wherever something
    requires grad; under `torch.no_grad()` no graph is kept.

    Args:
        loop: plant, controller and what stands between them.
        scenario: what to do, batched or not.
        solver: `Implicit()` if not given.
        weights: initial adaptive weights, as the controller's `initial_weights` gives them, each
            leaf (..., *event). If not given: random with `generator`, one draw a sample, else the
            controller's own.
        generator: source of random initial weights.
        batch_shape: batch shape of the initial weights; it must broadcast with those of the
            scenario and of the controller's constants.
        begin: where another rollout of this loop ended (`Trajectory.end`), a batch or one for all,
            in place of weights and of the scenario's start: every part goes on as it was, the
            slots, what laws, filters, actuator, sensor and clock keep. Time begins at 0, and with
            it reference, schedule and noise; what ticks goes on in step if the other rollout was a
            whole number of its periods long.
        sample_dt: interval [s] at which whole states are kept.
        sample_until: time [s] after which no whole states are kept.
        motion_dt: interval [s] at which the plant's state and the integral of squared error are
            kept; every step if not given. The integral counts every step in any case. Where nothing
            is kept between the ends, `Trajectory.error` is refused.
        effort_after: if given, rates of the commanded input are measured, and its peaks from this
            time on [s] (`input_rate`, `peak_input`).
        divergence_limit: a sample with a state entry beyond this, or NaN, is frozen there and
            reported in `status`; the others go on undisturbed.
        engine: ``compiled`` traces the loop's step and runs the rollout as one kernel, batches on
            `torch.get_num_threads()` cores; ``torch`` runs any loop and any solver;
            ``auto`` takes the compiled engine for a loop whose step can be traced.
            `Trajectory.engine` and `engine_reason` tell which was taken, and why.
        device: where the compiled engine runs, ``cpu`` or ``cuda``; what goes in and comes out is
            on the CPU.
        tape_memory: bytes that the compiled engine's backward pass may use for checkpoints; a
            longer rollout has fewer, and computes more again, to the same bits.
        gradient: ``plain``: decisions fall on step ends and have no gradient of their own;
            ``hybrid``: isolated switches and resets are located inside their step and
            differentiated through their time, chattering is averaged; `Trajectory.events` counts
            both (see `simulation/events`). Its values, too, are those of located events;
            ``soft``: the relaxed controller of `temperature` runs instead (see `relaxed`).
        temperature: of ``soft``, [-], a number or (...,).
        progress: called with the number of steps done since the last call.

    Raises:
        ConfigError: a setting is out of range, DomainError if it is a constant or a parameter of
            the plant, KindError if it is of a wrong type. ShapeError: sizes do not fit or batch
            shapes do not broadcast. DtypeError: a tensor of the loop, of its reference or of the
            scenario is not float64; it names the tensor. What the scenario holds is checked again.
    """
    instance("loop", loop, ClosedLoop)
    instance("scenario", scenario, Scenario).check()
    divergence_limit = number("divergence_limit", divergence_limit, ABOVE_0)
    tape_memory = number("tape_memory", tape_memory, ABOVE_0)
    sample_dt, sample_until = number("sample_dt", sample_dt), maybe("sample_until", sample_until)
    motion_dt = maybe("motion_dt", motion_dt)
    effort_after = maybe("effort_after", effort_after, NONNEGATIVE)
    batch_shape = sizes("batch_shape", batch_shape, single=False)
    if generator is not None:
        instance("generator", generator, torch.Generator)
    if progress is not None:
        function("progress", progress)
    if weights is not None and (generator is not None or batch_shape != ()):
        raise ConfigError("give initial weights as `weights`, or generator and batch_shape")
    if begin is not None:
        instance("begin", begin, Snapshot, "a Snapshot, as `Trajectory.end` gives it")
        if weights is not None or generator is not None or scenario.start is not None:
            raise ConfigError("begin has weights and the plant's state: give no other")
    solver = Implicit() if solver is None else solver
    check_gradient(gradient, solver, temperature, loop)
    if temperature is not None:
        loop = relaxed(loop, temperature)
    hybrid = locates_events(gradient, loop)
    obstacle = check_engine(loop, scenario, solver, engine, device)
    grid = grid_of(loop, scenario, solver.dt)
    task = dataclasses.replace(
        task_of(loop, scenario, solver, grid, weights, generator, batch_shape, begin),
        motion_rows=grid.motion_rows(motion_dt),
        state_rows=grid.samples(sample_dt, sample_until),
        limit=divergence_limit,
        progress=progress,
        device=device,
        tape_memory=tape_memory,
        effort_after=effort_after,
        hybrid=hybrid,
    )
    if task.batch.numel() == 0:
        obstacle = "an empty batch"
    elif obstacle is not None and engine == "auto" and solver.fuses_step:
        _warn_of_cost(task, obstacle)
    if obstacle is None:
        try:
            return _trajectory(task, compiled_engine.run(task))
        except (KernelError, UntraceableError) as error:
            obstacle = str(error)
            if engine == "compiled" or device != "cpu":
                if isinstance(error, KernelError):
                    raise
                raise ConfigError(
                    f"engine = '{engine}': {obstacle}; take engine = 'torch'"
                ) from error
            _warn_of_cost(task, obstacle)
    return _trajectory(task, torch_engine.run(task, obstacle))


@functools.cache
def _said(obstacle: str) -> None:
    log.warning("%s; the torch engine takes over, some 100 times slower", obstacle)


def _warn_of_cost(task: Task, obstacle: str) -> None:
    """One line, once for each obstacle, where the torch engine will be waited for."""
    if task.grid.n_steps > LONG:
        _said(obstacle)


def check_engine(
    loop: ClosedLoop,
    scenario: Scenario,
    solver: Solver,
    engine: str,
    device: str = "cpu",
) -> str | None:
    """None where the compiled engine may run this rollout, else why the torch engine does.

    What is known before anything is traced: whether the loop's step can be compiled shows when it
    is. Raises `ConfigError` for an unknown engine or device, or for ``compiled`` (and for any
    device but the CPU) where it can't be; `KindError`.
    """
    instance("loop", loop, ClosedLoop)
    instance("scenario", scenario, Scenario)
    instance("solver", solver, Solver)
    choice("engine", engine, ENGINES)
    text("device", device)
    obstacle: str | None = "asked for"
    if engine != "torch":
        obstacle = compiled_engine.obstacle(loop, scenario, solver)
    if obstacle is not None and engine == "compiled":
        raise ConfigError(f"engine = 'compiled': {obstacle}; take 'auto' or 'torch'")
    if device != "cpu":
        if obstacle is not None:
            raise ConfigError(f"device = '{device}': only the compiled engine has it ({obstacle})")
        compiled_engine.check_device(device)
    return obstacle


def _trajectory(task: Task, record: Record) -> Trajectory:
    times = task.grid.times
    rows, samples = len(record.motion), len(leaves(record.states.plant)[0])
    began = times[record.stopped.clamp(min=0)]
    kept = times[task.motion_rows[:rows]]
    return Trajectory(
        t=kept,
        plant=plant_states(task, record.motion),
        output=outputs_of(task, kept, record.motion),
        followed=record.followed,
        inputs=task.loop.plant.inputs,
        outputs=task.loop.plant.outputs,
        squared_error=record.squared_error,
        effort=record.effort,
        step_t=times,
        horizon=task.horizon,
        sample_t=times[task.state_rows[:samples]],
        states=record.states,
        modes=record.modes.controller,
        held=record.modes,
        final_mode=record.final_mode.controller,
        status=record.kind,
        stopped_at=torch.where(record.stopped >= 0, began, torch.nan),
        cause=record.leaf,
        leaf_names=leaf_names(task.state),
        solver=task.solver.name,
        engine=record.engine,
        engine_reason=record.reason,
        signal=task.surroundings.reference,
        events=record.events,
    )
