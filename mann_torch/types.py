"""Typed values that travel between the layers.

Shape letters, used in every docstring of the library:

``...`` any leading batch dimensions, T samples in time, n joints, I network inputs (5n),
N hidden neurons, S memory slots, D key width.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from torch import Tensor

from .trees import portable


class Measurement(NamedTuple):
    """What the controller sees of the plant (paper: x, dx/dt)."""

    q: Tensor  # (..., n) joint position [rad]
    qd: Tensor  # (..., n) joint velocity [rad/s]


class ReferenceSample(NamedTuple):
    """Desired trajectory at one time (paper: s, ds/dt, d2s/dt2)."""

    q: Tensor  # (..., n) [rad]
    qd: Tensor  # (..., n) [rad/s]
    qdd: Tensor  # (..., n) [rad/s^2]


@portable
class PlantState(NamedTuple):
    """State of the arm."""

    q: Tensor  # (..., n) [rad]
    qd: Tensor  # (..., n) [rad/s]


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
    """All adaptive state of the controller; `memory` is None for the plain network."""

    network: NetworkState
    memory: MemoryState | None


class ControlSignals(NamedTuple):
    """Quantities worth plotting, computed on the way to the torque."""

    tracking: TrackingError
    features: Features
    read: Tensor | None  # (..., N) h_o
    weights: Tensor | None  # (..., S) w_r
    gain: Tensor  # (...,) K_v + k_v (|W| + |V| + |mu| + Z_m) [N m s/rad]


class ControlOutput(NamedTuple):
    """Result of one controller evaluation."""

    torque: Tensor  # (..., n) [N m]
    d_state: ControllerState
    signals: ControlSignals


class TorqueGains(NamedTuple):
    """How the torque answers to position, velocity and time."""

    position: Tensor  # (..., n, n) -d tau/d q [N m/rad]
    rate: Tensor  # (..., n, n) -d tau/d qd [N m s/rad]
    drift: Tensor  # (..., n) d tau/d t while the state stands still [N m/s]


class Linearization(NamedTuple):
    """The stiff block of the loop: d(qdd) = -stiffness dq - damping d(qd) + drift dt."""

    stiffness: Tensor  # (..., n, n) [1/s^2]
    damping: Tensor  # (..., n, n) [1/s]
    drift: Tensor  # (..., n) [rad/s^3]


@portable
class LoopState(NamedTuple):
    """State of plant and controller together: what an ODE solver integrates."""

    plant: PlantState
    controller: ControllerState


# A controller's discrete mode; the memory's for MannController, None for a controller without.
Mode = Any
