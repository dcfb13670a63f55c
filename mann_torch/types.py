"""Typed values that travel between the layers.

Shape letters, used in every docstring of the library:

``...`` any leading batch dimensions, T samples in time, n joints, m inputs and p outputs, I network
inputs (the paper's: 5n), N hidden neurons, S memory slots, D key width.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from torch import Tensor

from .errors import InterfaceError
from .trees import portable

#: Derivatives that a `ReferenceSample` has room for.
MOST_DERIVATIVES = 4


class Channel(NamedTuple):
    """One number that goes into a plant or comes out of it: how tables and pictures call it."""

    name: str
    unit: str


class Measurement(NamedTuple):
    """What a controller sees of a mechanical plant (paper: x, dx/dt)."""

    q: Tensor  # (..., n) position [rad]
    qd: Tensor  # (..., n) velocity [rad/s]


class ReferenceSample(NamedTuple):
    """Desired output at one time, with as many time derivatives as the reference has.

    Paper: s, ds/dt, d2s/dt2. `upto` is how a controller asks for them.
    """

    value: Tensor  # (..., p), in the output's units
    rate: Tensor | None = None  # (..., p), per s
    acceleration: Tensor | None = None  # (..., p), per s^2
    jerk: Tensor | None = None  # (..., p), per s^3
    snap: Tensor | None = None  # (..., p), per s^4
    #: (..., p) what a reference model is told to follow, where the value is the model's output.
    command: Tensor | None = None
    state: Tensor | None = None  # (..., d) of that model

    @property
    def parts(self) -> tuple[Tensor | None, ...]:
        """The value and its derivatives, None where there is none."""
        return self[: MOST_DERIVATIVES + 1]

    def upto(self, order: int) -> tuple[Tensor, ...]:
        """The value and its first `order` derivatives. Raises `InterfaceError` if one is not there.

        `reference_order` of a controller says how many it asks for: a loop checks that.
        """
        found = tuple(part for part in self.parts[: order + 1] if part is not None)
        if len(found) <= order:
            raise InterfaceError(
                f"derivative {order} of the reference is asked for, it has {len(found) - 1}: "
                "the controller's reference_order must say so"
            )
        return found


@portable
class PlantState(NamedTuple):
    """State of a mechanical plant."""

    q: Tensor  # (..., n) position [rad]
    qd: Tensor  # (..., n) velocity [rad/s]


@portable
class NetworkState(NamedTuple):
    """Adaptive weights. They are state, not parameters: the update law moves them."""

    W: Tensor  # (..., N, n) outer weights
    b_w: Tensor  # (..., n) outer bias
    V: Tensor  # (..., I, N) inner weights
    b_v: Tensor  # (..., N) inner bias


@portable
class MemoryState(NamedTuple):
    """Contents and keys of the working memory."""

    mu: Tensor  # (..., S, N) slot contents (paper: mu_i, h_i)
    keys: Tensor  # (..., S, D) keys with a motion of their own; D = 0 if there are none


@portable
class MemoryMode(NamedTuple):
    """What is frozen while the loop flows and changed by jumps.

    All of it is discrete but the activity levels of relaxed attention, which carry gradients.
    """

    active: Tensor  # (..., S) bool, slots in use; relaxed attention: float64 levels in [0, 1]
    attended: Tensor  # (...,) int64, slot with the largest weight; -1 before the first decision
    switches: Tensor  # (...,) int64, changes of the attended slot so far
    reallocations: Tensor  # (...,) int64, resets so far
    held: Tensor | None = None  # (..., S) weights in force; None: attention decides
    law: Any = None  # what an adaptive law beside the memory decides


class Shift(NamedTuple):
    """Decision to shift attention (paper: a_r, i_s)."""

    fires: Tensor  # (...,) bool, a_r = 1; relaxed: float64, the degree p in [0, 1]
    target: Tensor  # (..., S) bool, 1 on the slot i_s; relaxed: float64, shares of the degree


class Proximity(NamedTuple):
    """What attention's decisions compare, differentiable."""

    distances: Tensor  # (..., S) of the slots that attention compares; inf for unused slots
    margin: Tensor  # (...,) min R - theta; >= 0: a reset is due, -inf: none can come


class Comparison(NamedTuple):
    """A query with the keys it is compared with; `keys / scale` has the query's units."""

    query: Tensor  # (..., D)
    keys: Tensor  # (..., S, D)
    scale: Tensor  # (...,) or scalar: c_w for representation keys, 1 for state keys


@portable
class MemoryOutput(NamedTuple):
    """What one evaluation of the working memory gives."""

    read: Tensor  # (..., N) h_o
    weights: Tensor  # (..., S) w_r
    d_memory: MemoryState  # time derivative


class Features(NamedTuple):
    """Hidden layer of the adaptive network at one input."""

    pre: Tensor  # (..., N) V' x~ + b_v
    hidden: Tensor  # (..., N) sigma
    slope: Tensor  # (..., N) sigma (1 - sigma)


class TrackingError(NamedTuple):
    """Tracking errors (paper: e, de/dt, r = de/dt + Lambda e)."""

    error: Tensor  # (..., n) [rad]
    error_rate: Tensor  # (..., n) [rad/s]
    filtered_error: Tensor  # (..., n) [rad/s]


@portable
class ControllerState(NamedTuple):
    """Weights of a network, in its own form, a memory, and laws; None where there is none."""

    network: Any
    memory: MemoryState | None
    laws: Any = None  # what the laws of the weights keep
    readouts: Any = None  # what the slots of readouts hold


class ControlSignals(NamedTuple):
    """Quantities of `MannController` worth plotting, computed on the way to the input."""

    tracking: TrackingError
    features: Features
    read: Tensor | None  # (..., N) h_o
    weights: Tensor | None  # (..., S) w_r
    gain: Tensor  # (...,) K_v + k_v (|W| + |V| + |mu| + Z_m) [N m s/rad]


class ControlOutput(NamedTuple):
    """Result of one controller evaluation."""

    input: Tensor  # (..., m) what the plant is given, in its inputs' units (paper: tau)
    d_state: Any  # time derivative of the controller's state, a tree like it
    signals: Any  # a NamedTuple of quantities worth plotting, or None
    #: A tree like the state of rates l >= 0 [1/s], None where a number has none: d_state is
    #: a - l x there, and a sampled controller moves it exactly (`control.sampling`).
    decay: Any = None


class InputGains(NamedTuple):
    """How a controller's input answers to what is measured and to time."""

    measurement: Tensor  # (..., m, Y) -d input/d measurement, fields of the measurement in order
    drift: Tensor  # (..., m) d input/d t while the measurement stands still


# Trees of tensors, or None, of a controller's own: its state and its discrete mode.
ControllerTree = Any
Mode = Any


@portable
class LoopState(NamedTuple):
    """State of all parts of a loop together: what an ODE solver integrates.

    The plant's comes first; None where a part is missing or has no state.
    """

    plant: Any
    controller: ControllerTree
    actuator: Any = None  # (..., m) what a lagging actuator gives
    model: Any = None  # state of a reference model


@portable
class SensorState(NamedTuple):
    """What a sampling sensor holds."""

    buffer: Tensor  # (..., D + 1, Y) samples on their way, the newest first


@portable
class ClockState(NamedTuple):
    """What a clock holds from tick to tick."""

    input: Tensor  # (..., m) in force
    rates: ControllerTree  # of the controller's state at the last tick
    begun: Tensor  # (...,) bool, whether there was a tick
    slope: Tensor | None = None  # (..., m) of the input, per s, where it holds on a line
    at: Tensor | None = None  # (...,) [s] the last tick, there
    decay: Any = None  # how fast numbers of the state forget, at the last tick


@portable
class LoopMode(NamedTuple):
    """What is frozen while the loop flows, and changed by jumps."""

    controller: Mode
    sensor: SensorState | None = None
    clock: ClockState | None = None


@portable
class Snapshot(NamedTuple):
    """A loop at an instant, with all that its parts keep: what a rollout may begin at."""

    state: LoopState
    mode: LoopMode
