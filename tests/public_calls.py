"""Every public constructor and function with arguments that are right, all of them given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

import mann_torch as mt
from mann_torch import control, memory, plants, signals, simulation, tuning
from mann_torch.constraints import Positive
from mann_torch.functional import as_float64
from tests.conftest import generator, make_controller, make_loop, make_scenario, randn

Call = tuple[Callable[..., Any], dict[str, Any]]

LOOP, SCENARIO, SOLVER = (
    make_loop("reallocating_always"),
    make_scenario(0.02, (0.01,)),
    mt.Implicit(),
)
CONTROLLER = LOOP.controller
NETWORK = CONTROLLER.initial_network((2,), generator())
NOISE = mt.MeasurementNoise(0.1, 0.1, [0, 1])
RUN = mt.rollout(LOOP, SCENARIO, network=NETWORK, engine="torch", effort_after=0.0)
ROLLOUT = {"loop": LOOP, "scenario": SCENARIO, "solver": SOLVER, "network": NETWORK}

CELL = mt.MemoryCell(3, 6, 4, mt.ReallocatingAttention("always"), dtype=torch.float64)
STATE, X = CELL.initial_state((2,)), randn(2, 3)
SEEN = CELL.attend(X, STATE)
SEQUENCE = mt.MemorySequence(CELL)
TRACE = SEQUENCE.trace(randn(5, 2, 3))
MEMORY, HIDDEN = CELL.memory, randn(2, 6)

BATCH = mt.Scenario.stack([SCENARIO, SCENARIO])
ENSEMBLE = tuning.Ensemble(LOOP, BATCH, NETWORK, SOLVER, {}, 0.0, "torch")
COORDINATES = tuning.Coordinates(CONTROLLER, ["rate_W"])
Z = torch.zeros(1, dtype=torch.float64)
SETTINGS = tuning.GradientSettings("fd")
TUNER = tuning.Tuner(ENSEMBLE, COORDINATES, tuning.Objective(), SETTINGS, tuning.Schedule(1))


def judge(run: mt.Outcome) -> torch.Tensor:
    return mt.srmse(run).sum(-1)


def values(points: torch.Tensor) -> torch.Tensor:
    return points.square().sum(-1)


def member(*index: Any) -> Any:
    return TRACE.member(*index)


SMOOTHED = {"values": values, "z": Z, "members": 2}
SLOPE = {"ensemble": ENSEMBLE, "coordinates": COORDINATES, "z": Z, "judge": judge}
NUMBERS = dict.fromkeys(("write_gain", "rate_W", "error_gain"), 2.0)
TRACK = {"after": 0.01, "trajectory": RUN}

#: What can be called with arguments, by its public name.
CALLS: dict[str, Call] = {
    # the memory
    "ReallocatingAttention": (
        mt.ReallocatingAttention,
        {"phase": "always", "shift_threshold": 0.2},
    ),
    "RelaxedAttention": (
        mt.RelaxedAttention,
        {"temperature": 0.1, "phase": "initial", "shift_threshold": 0.2},
    ),
    "StateKeys": (mt.StateKeys, {"key_rate": 1.0}),
    "WorkingMemory": (
        mt.WorkingMemory,
        {
            "n_slots": 3,
            "n_hidden": 6,
            "attention": mt.HardAttention(),
            "key_rule": mt.StateKeys(),
            "context_width": 2,
            "write_gain": 0.5,
            "reset": "raw",
        },
    ),
    "WorkingMemory.initial_mode": (MEMORY.initial_mode, {"batch_shape": (2,)}),
    "WorkingMemory.initial_state": (MEMORY.initial_state, {"hidden": HIDDEN, "context": X}),
    "WorkingMemory.store_": (
        MEMORY.store_,
        {"state": mt.types.MemoryState(STATE.mu[0], STATE.keys[0]), "active": STATE.active[0]},
    ),
    "WorkingMemory.forward": (
        MEMORY.forward,
        {
            "hidden": HIDDEN,
            "correction": HIDDEN,
            "context": X,
            "memory": STATE.memory,
            "mode": STATE.mode,
        },
    ),
    "MemoryCell": (
        mt.MemoryCell,
        {
            "input_size": 3,
            "hidden_size": 6,
            "n_slots": 4,
            "attention": mt.SoftAttention(),
            "key_rule": mt.StateKeys(),
            "context_size": 2,
            "output_size": 2,
            "features": torch.nn.Linear(3, 6),
            "clock": True,
            "dt": 1.0,
            "write_gain": 0.5,
            "reset": "raw",
            "dtype": torch.float32,
        },
    ),
    "MemoryCell.initial_state": (CELL.initial_state, {"batch_shape": (2,)}),
    "MemoryCell.initial_state_at": (CELL.initial_state_at, {"x": X}),
    "MemoryCell.forward": (
        CELL.forward,
        {"x": X, "state": STATE, "correction": HIDDEN, "dt": 0.5},
    ),
    "MemoryCell.attend": (CELL.attend, {"x": X, "state": STATE, "dt": 0.5}),
    "MemoryCell.write": (CELL.write, {"seen": SEEN, "correction": HIDDEN}),
    "MemoryCell.output_of": (CELL.output_of, {"seen": SEEN}),
    "MemoryCell.flow": (CELL.flow, {"x": X, "state": STATE, "correction": HIDDEN}),
    "MemoryCell.jump": (CELL.jump, {"x": X, "state": STATE}),
    "MemorySequence": (mt.MemorySequence, {"cell": CELL, "batch_first": True}),
    "MemorySequence.forward": (
        SEQUENCE.forward,
        {"x": randn(5, 2, 3), "state": STATE, "dt": torch.ones(5, 2)},
    ),
    "MemorySequence.trace": (
        SEQUENCE.trace,
        {"x": randn(5, 2, 3), "state": STATE, "dt": torch.ones(5, 2)},
    ),
    "reallocation_log": (lambda trace: memory.reallocation_log(trace, 1), {"trace": TRACE}),
    "MemoryTrace.member": (lambda index: member(index), {"index": 1}),
    "relaxed": (mt.relaxed, {"module": LOOP, "temperature": 0.1}),
    "memory_figure": (
        mt.memory_figure,
        {
            "runs": {"one": TRACE.member(0)},
            "t": TRACE.member(0)["attended"],
            "title": "",
            "marks": [1.0],
            "t_label": "t",
        },
    ),
    # control and plants
    "MannController": (
        mt.MannController,
        {
            "n_joints": 2,
            "n_hidden": 6,
            "memory": mt.WorkingMemory(4, 6, mt.HardAttention()),
            "error_gain": 5.0,
            "base_gain": 20.0,
            "robust_gain": 10.0,
            "weight_bound": 0.0,
            "rate_W": 10.0,
            "rate_V": 10.0,
            "e_modification": 0.0,
            "initial_std": 0.1,
        },
    ),
    "AdaptiveNetwork": (
        control.AdaptiveNetwork,
        {
            "n_inputs": 10,
            "n_hidden": 6,
            "n_outputs": 2,
            "rate_W": 10.0,
            "rate_V": 10.0,
            "e_modification": 0.0,
            "initial_std": 0.1,
        },
    ),
    "FilteredTracking": (control.FilteredTracking, {"n_joints": 2, "error_gain": 5.0}),
    "RobustGain": (
        control.RobustGain,
        {"base_gain": 20.0, "robust_gain": 10.0, "weight_bound": 0.0},
    ),
    "equal_parameter_hidden": (
        mt.equal_parameter_hidden,
        {"n_inputs": 10, "n_outputs": 2, "n_hidden": 10, "n_slots": 5},
    ),
    "Controller.initial_network": (
        CONTROLLER.initial_network,
        {"batch_shape": (2,), "generator": generator()},
    ),
    "DesignModule.initialize": (CONTROLLER.initialize, NUMBERS),
    "DesignModule.share": (
        make_controller("nn").share,
        {"name": "rate_W", "tensor": torch.ones((), dtype=torch.float64)},
    ),
    "DesignModule.declare": (
        make_controller("nn").declare,
        {"name": "own", "value": 1.0, "domain": Positive(), "event_shape": ()},
    ),
    "TwoLinkArm": (mt.TwoLinkArm, {"gravity": 9.8, "coulomb_velocity": 0.01}),
    "TwoLinkArm.check": (LOOP.plant.check, {"parameters": mt.arm_parameters()}),
    "arm_parameters": (
        plants.arm_parameters,
        dict.fromkeys(("masses", "lengths", "viscous", "coulomb"), (1.0, 1.0)),
    ),
    # signals
    "Sinusoid": (mt.Sinusoid, {"amplitude": [1.0, 1.0], "frequency": 0.5, "offset": 0.0}),
    "PiecewiseConstant": (mt.PiecewiseConstant, {"times": [1.0], "values": [[1.0], [2.0]]}),
    "PiecewiseConstant.stack": (
        mt.PiecewiseConstant.stack,
        {"schedules": [SCENARIO.schedule["masses"]]},
    ),
    "MeasurementNoise": (
        mt.MeasurementNoise,
        {"position_std": 0.1, "velocity_std": 0.1, "seed": 0, "rate": 100.0},
    ),
    "MeasurementNoise.stack": (mt.MeasurementNoise.stack, {"noises": [NOISE]}),
    "multiplied": (signals.multiplied, {"initial": [1.0], "factors": [2.0]}),
    "growing_square": (signals.growing_square, {"initial": [1.0], "increment": 0.2, "jumps": 3}),
    "as_float64": (lambda value: as_float64(value), {"value": 1.0}),
    # simulation
    "ClosedLoop": (mt.ClosedLoop, {"plant": LOOP.plant, "controller": CONTROLLER}),
    "Scenario": (
        mt.Scenario,
        {
            "reference": SCENARIO.reference,
            "parameters": SCENARIO.parameters,
            "horizon": 0.02,
            "schedule": {},
            "start": SCENARIO.start_state(),
            "noise": NOISE,
            "name": "mine",
        },
    ),
    "Scenario.stack": (mt.Scenario.stack, {"scenarios": [SCENARIO], "name": "mine"}),
    "Scenario.select": (BATCH.select, {"members": [0]}),
    "Implicit": (mt.Implicit, {"dt": 4e-3, "compile": False, "follow_reference": True}),
    "Odeint": (
        mt.Odeint,
        {
            "method": "rk4",
            "dt": 4e-3,
            "rtol": 1e-5,
            "atol": 1e-8,
            "max_step": 1e-3,
            "max_evaluations": 100,
            "compile": False,
        },
    ),
    "rollout": (
        mt.rollout,
        {
            **ROLLOUT,
            "sample_dt": 0.01,
            "sample_until": 0.01,
            "motion_dt": 0.01,
            "effort_after": 0.0,
            "divergence_limit": 1e8,
            "engine": "torch",
            "device": "cpu",
            "tape_memory": 256e6,
            "gradient": "soft",
            "temperature": 0.1,
            "progress": lambda steps: None,
        },
    ),
    "rollout of a draw": (
        lambda batch_shape, generator=None: mt.rollout(
            LOOP, SCENARIO, generator=generator, batch_shape=batch_shape, engine="torch"
        ),
        {"generator": generator(), "batch_shape": (2,)},
    ),
    "explain": (mt.explain, {**ROLLOUT, "gradient": "soft", "temperature": 0.1}),
    "observe": (mt.observe, {"loop": LOOP, "scenario": SCENARIO, "trajectory": RUN}),
    "attended_slot": (simulation.attended_slot, {"trajectory": RUN}),
    "check_engine": (
        simulation.check_engine,
        {
            "loop": LOOP,
            "scenario": SCENARIO,
            "solver": SOLVER,
            "engine": "torch",
            "device": "cpu",
        },
    ),
    "check_gradient": (
        simulation.check_gradient,
        {"gradient": "soft", "solver": SOLVER, "temperature": 0.1},
    ),
    "srmse": (mt.srmse, TRACK),
    **{
        name: (getattr(mt, name), {"trajectory": RUN})
        for name in ("torque_rate", "peak_torque", "reallocations", "switches")
    },
    # tuning
    "Coordinates": (
        tuning.Coordinates,
        {"module": CONTROLLER, "names": ["rate_W"], "matrix_form": "scalar"},
    ),
    "Coordinates.values": (COORDINATES.values, {"z": Z}),
    "Limit": (tuning.Limit, {"quantity": judge, "bound": 1.0, "relative": False}),
    "Criterion": (
        tuning.Criterion,
        {"value": judge, "limits": {}, "penalty": 20.0, "scale": 1.0},
    ),
    "Objective": (
        tuning.Objective,
        {
            "effort_weight": 0.0,
            "rate_limit": 1.0,
            "peak_limit": 1.0,
            "saturation": 1.0,
            "penalty": 20.0,
        },
    ),
    "Ensemble": (
        tuning.Ensemble,
        {
            **ROLLOUT,
            "scenario": BATCH,
            "own": {},
            "effort_after": 0.0,
            "engine": "torch",
            "device": "cpu",
        },
    ),
    "Ensemble.until": (ENSEMBLE.until, {"horizon": 1.0}),
    "Ensemble.select": (ENSEMBLE.select, {"members": [0]}),
    "Ensemble.scores": (ENSEMBLE.scores, {"values": {}, "progress": None}),
    "Ensemble.judged": (ENSEMBLE.judged, {"values": {}, "judge": judge, "progress": None}),
    "Ensemble.run": (
        ENSEMBLE.run,
        {
            "values": {},
            "gradient": "soft",
            "temperature": 0.1,
            "progress": None,
            "recording": tuning.TOTALS,
        },
    ),
    "constants_at": (
        lambda module, values: tuning.constants_at(module, values).__enter__(),
        {"module": CONTROLLER, "values": {}},
    ),
    "score": (tuning.score, {"trajectory": RUN}),
    "Judged": (tuning.Judged, {"judge": judge, "recording": tuning.MOTION}),
    "Recording": (
        tuning.Recording,
        {"motion_dt": 0.1, "sample_dt": 0.1, "sample_until": 1.0, "totals_only": False},
    ),
    "GradientSettings": (
        tuning.GradientSettings,
        {
            "mode": "fd",
            "spread": 0.1,
            "pairs": 2,
            "design": "each",
            "control": (),
            "step": 0.1,
            "temperature": 0.1,
            "final_temperature": 0.1,
        },
    ),
    "slope_of": (
        tuning.slope_of,
        {**SLOPE, "settings": SETTINGS, "generator": generator(), "progress": 0.0},
    ),
    "pathwise_slopes": (tuning.pathwise_slopes, {**SLOPE, "mode": "soft", "temperature": 0.1}),
    "control_of": (
        tuning.control_of,
        {"exact": torch.zeros(2, 1), "coordinates": COORDINATES, "names": ["rate_W"]},
    ),
    "differences": (tuning.differences, {**SMOOTHED, "step": 0.1}),
    "smoothed": (
        tuning.smoothed,
        {
            **SMOOTHED,
            "spread": 0.1,
            "pairs": 2,
            "design": "each",
            "generator": generator(),
            "control": torch.zeros(2, 1),
        },
    ),
    "Schedule": (
        tuning.Schedule,
        {
            "iterations": 2,
            "optimizer": "adam",
            "rate": 0.1,
            "minibatch": 2,
            "curriculum": [(0, 1.0)],
            "seed": 0,
        },
    ),
    "Tuner": (
        tuning.Tuner,
        {
            "ensemble": ENSEMBLE,
            "coordinates": COORDINATES,
            "objective": tuning.Objective(),
            "gradient": SETTINGS,
            "schedule": tuning.Schedule(1),
            "history": [],
        },
    ),
    "Tuner.load_state_dict": (TUNER.load_state_dict, {"state": TUNER.state_dict()}),
}
