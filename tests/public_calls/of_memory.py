"""Calls of the memory."""

from __future__ import annotations

from typing import Any

import torch

import mann_torch as mt
from mann_torch import memory
from mann_torch.testing import check_attention, check_key_rule
from tests.conftest import randn
from tests.public_calls.things import LOOP, Call

CELL = mt.MemoryCell.paper(3, 6, 4, mt.ReallocatingAttention("always"), dtype=torch.float64)
STATE, X = CELL.initial_state((2,)), randn(2, 3)
SEEN = CELL.attend(X, STATE)
SEQUENCE = mt.MemorySequence(CELL, engine="torch")
STREAM = mt.MemoryStream(CELL, (2,))
LAYERS = mt.MemoryLayers(3, 6, 2, dtype=torch.float64, engine="torch")
TRACE = SEQUENCE.trace(randn(5, 2, 3))
MEMORY, HIDDEN = CELL.memory, randn(2, 6)


def member(*index: Any) -> Any:
    return TRACE.member(*index)


CALLS: dict[str, Call] = {
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
            "directions": True,
            "features": torch.nn.Linear(3, 6),
            "inertia": True,
            "clock": True,
            "writing": "next",
            "dt": 1.0,
            "write_gain": 0.5,
            "reset": "raw",
            "dtype": torch.float32,
        },
    ),
    "MemoryCell.paper": (
        mt.MemoryCell.paper,
        {
            "input_size": 3,
            "hidden_size": 6,
            "n_slots": 4,
            "attention": mt.SoftAttention(),
            "key_rule": mt.StateKeys(),
        },
    ),
    "MemoryCell.look": (CELL.look, {"x": X, "dt": torch.ones(2, dtype=torch.float64)}),
    "MemoryCell.check_state": (CELL.check_state, {"state": STATE}),
    "Directions": (memory.Directions, {"input_size": 3, "width": 4}),
    "Inertia": (memory.Inertia, {"input_size": 3, "hidden_size": 4}),
    "MemoryLayers": (
        mt.MemoryLayers,
        {
            "input_size": 3,
            "hidden_size": 6,
            "num_layers": 2,
            "batch_first": False,
            "dropout": 0.1,
            "bidirectional": False,
            "return_state": True,
            "engine": "torch",
        },
    ),
    "MemoryLayers.initial_state": (LAYERS.initial_state, {"batch_shape": (2,)}),
    "MemoryLayers.forward": (
        LAYERS.forward,
        {
            "x": randn(5, 2, 3),
            "state": LAYERS.initial_state(2),
            "dt": torch.ones(5, 2, dtype=torch.float64),
            "lengths": [5, 3],
            "reset": torch.zeros(5, 2, dtype=torch.bool),
            "valid": torch.ones(5, 2, dtype=torch.bool),
        },
    ),
    "MemoryStream.begun": (
        STREAM.begun,
        {"state": STREAM.initial_state(), "reset": torch.tensor([True, False])},
    ),
    "MemoryStream": (mt.MemoryStream, {"cell": CELL, "batch_shape": (2,)}),
    "MemoryStream.packed": (STREAM.packed, {"state": STATE}),
    "MemoryStream.unpacked": (STREAM.unpacked, {"state": STREAM.initial_state()}),
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
    "MemorySequence": (
        mt.MemorySequence,
        {"cell": CELL, "batch_first": True, "engine": "auto"},
    ),
    "MemorySequence.taken": (SEQUENCE.taken, {"x": randn(5, 2, 3)}),
    "MemorySequence.forward": (
        SEQUENCE.forward,
        {
            "x": randn(5, 2, 3),
            "state": STATE,
            "dt": torch.ones(5, 2),
            "lengths": [5, 3],
            "reset": torch.zeros(5, 2, dtype=torch.bool),
            "valid": torch.ones(5, 2, dtype=torch.bool),
        },
    ),
    "MemorySequence.trace": (
        SEQUENCE.trace,
        {
            "x": randn(5, 2, 3),
            "state": STATE,
            "dt": torch.ones(5, 2),
            "lengths": [5, 3],
            "reset": torch.zeros(5, 2, dtype=torch.bool),
            "valid": torch.ones(5, 2, dtype=torch.bool),
        },
    ),
    "reallocation_log": (lambda trace: memory.reallocation_log(trace, 1), {"trace": TRACE}),
    "MemoryTrace.member": (lambda index: member(index), {"index": 1}),
    "check_attention": (
        check_attention,
        {"attention": mt.HardAttention(), "key_rule": mt.StateKeys()},
    ),
    "check_key_rule": (check_key_rule, {"rule": mt.StateKeys()}),
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
}
