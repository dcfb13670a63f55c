"""Every argument of every public call, given what it is not: a named error that names it."""

from __future__ import annotations

import inspect
import re
from typing import Any

import pytest

import mann_torch as mt
from mann_torch import (
    control,
    deployment,
    memory,
    parts,
    plants,
    signals,
    simulation,
    simulators,
    testing,
    tuning,
)
from tests.public_calls import CALLS

WRONG: dict[str, Any] = {
    "a string": "nonsense",
    "None": None,
    "a bool": True,
    "a list": [object()],
    "an object": object(),
}
#: Arguments that may be these: of texts any, of flags True.
TEXTS = {("Scenario", "name"), ("Scenario.stack", "name"), ("DesignModule.declare", "name")}
TEXTS |= {("Spline.from_file", "path"), ("channels", "prefix"), ("channels", "unit")}
TEXTS |= {
    ("ConstantGain", "name"),
    ("Estimator", "features"),
    ("Estimator", "label"),
    ("MeasuredLabels", "field"),
    ("memory_figure", "title"),
    ("memory_figure", "t_label"),
    ("Ensemble", "device"),
    ("Stepper.to_c", "folder"),
    ("Stepper.to_c", "name"),
}
#: Where the message calls an argument by another name, or must not find it in a longer word.
SAID = {
    ("Coordinates", "matrix_form"): "matrix form",
    ("WorkingMemory.initial_state", "hidden"): "features",
    ("WorkingMemory.forward", "hidden"): "features",
    ("DesignModule.tune", "names"): "no design constant",
    ("DesignModule.share", "name"): "no design constant",
    ("DesignModule.share", "tensor"): "rate_W",
    ("DesignModule.declare", "value"): "own",
}
#: What takes no arguments, is made by the library alone, or is an interface.
PASSIVE = {
    *(
        "Attended",
        "CellState",
        "Looked",
        "Taken",
        "MemoryTrace",
        "NetworkState",
        "PlantState",
        "ArmParameters",
    ),
    *("ArmCoefficients", "NoiseTable", "Score", "Slope", "Effort", "EventCounts", "Explanation"),
    *("Motion", "Outcome", "Trajectory", "Status", "Attention", "KeyRule", "Controller", "Plant"),
    *("Reference", "Solver", "Flow", "Aim", "Judge", "Sampler", "FeatureNetwork", "NetworkInputs"),
    *("Law", "ReferenceModel", "Channel", "ControlOutput", "ReferenceSample", "Observation"),
    *("Forces", "Outside", "Surroundings", "ReadoutState"),
    *("HardAttention", "SoftAttention", "RepresentationKeys"),
    *("Field", "Input", "Torque", "MechanicalPlant", "RowState", "MeasuredOutput"),
    *("SlotineLiArm", "SlotineLiParameters", "PlanarQuadrotor", "QuadrotorParameters"),
    *("NLinkParameters", "NLinkCoefficients", "FlexibleJointParameters", "CartPoleParameters"),
    *("FlexibleJointCoefficients", "LinearParameters", "LinearCoefficients", "WingRockParameters"),
    *("PendulumParameters", "PendulumCoefficients", "DoubleIntegratorParameters"),
    *("Drive", "Pair", "Approximation", "Gain", "GainInForce", "Gate", "Guard", "Leak", "Term"),
    *("LawPart", "Basis", "Mechanics", "FreezeWhileSaturated"),
    *("Regression", "RegressionMeasurement", "RegressionParameters", "RegressionState"),
    *("LawPart", "Basis", "Labels", "Saturation", "WingRockMeasurement"),
    *("Moment", "MujocoRun", "Payload", "Policy", "Run"),
    *("Blob", "Kept", "Ports", "Stepped", "Stepper", "Tick", "Ticked"),
    *("noise_at", "scaled"),  # tensor maths inside the rollout
}


def wrongs(name: str, argument: str) -> list[str]:
    """Names of what this argument must not be."""
    known = inspect.signature(CALLS[name][0]).parameters
    hint = str(known[argument].annotation) if argument in known else ""
    allowed = set()
    if "None" in hint or (argument in known and known[argument].default is None):
        allowed.add("None")
    if "bool" in hint:
        allowed.add("a bool")
    if (name, argument) in TEXTS:
        allowed.add("a string")
    return [what for what in WRONG if what not in allowed]


@pytest.mark.parametrize("name", CALLS)
def test_right_arguments_are_taken(name: str) -> None:
    call, good = CALLS[name]
    if name != "explain":  # it compiles: see docs/compiling.md and its test
        call(**good)
    known = inspect.signature(call).parameters.values()
    named = {p.name for p in known if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}
    missing = {"rollout": {"generator", "batch_shape", "begin"}}  # given in a call of their own
    assert named - set(good) == missing.get(name, set())


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_type_is_a_named_error(name: str) -> None:
    call, good = CALLS[name]
    for argument in good:
        for what in wrongs(name, argument):
            with pytest.raises(mt.ConfigError) as caught:
                call(**{**good, argument: WRONG[what]})
                pytest.fail(f"{argument} may be {what}")
            word = SAID.get((name, argument), rf"\b{argument}\b")
            assert re.search(word, str(caught.value)), (argument, what, str(caught.value))


def test_the_table_is_long_and_misses_nothing_public() -> None:
    given = [(name, argument) for name, (_, good) in CALLS.items() for argument in good]
    assert sum(len(wrongs(*each)) for each in given) >= 2000
    covered = {name.split(".")[0] for name in CALLS}
    packages = (
        mt,
        control,
        deployment,
        memory,
        parts,
        plants,
        signals,
        simulation,
        simulators,
        testing,
        tuning,
    )
    for package in packages:
        for name in package.__all__:
            found = getattr(package, name)
            if callable(found) and not (inspect.isclass(found) and issubclass(found, Exception)):
                assert name in covered | PASSIVE, name
