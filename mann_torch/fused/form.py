"""What a fused kernel is specialised to, and which loops have a fused form."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

from ..control import (
    AdaptiveNetwork,
    Controller,
    FilteredTracking,
    MannController,
    RobustGain,
)
from ..memory import (
    Attention,
    HardAttention,
    KeyRule,
    ReallocatingAttention,
    RepresentationKeys,
    StateKeys,
    WorkingMemory,
)
from ..plants import Plant, TwoLinkArm
from ..signals import Reference, Sinusoid

#: Torch classes and the file in `equations` that mirrors each. Exact types only: a subclass may
#: mean another equation.
PLANTS: dict[type[Plant], str] = {TwoLinkArm: "arm"}
REFERENCES: dict[type[Reference], str] = {Sinusoid: "sinusoid"}
CONTROLLERS: dict[type[Controller], str] = {MannController: "closed_loop"}
CONTROL_PARTS = (FilteredTracking, AdaptiveNetwork, RobustGain, WorkingMemory)
ATTENTIONS: dict[type[Attention], str] = {
    HardAttention: "hard",
    ReallocatingAttention: "reallocating",
}
KEY_RULES: dict[type[KeyRule], str] = {RepresentationKeys: "representation", StateKeys: "state"}

#: Order of a sample's row of scalar constants.
CONSTANTS = (
    "base_gain",
    "robust_gain",
    "weight_bound",
    "rate_W",
    "rate_V",
    "e_modification",
    "write_gain",
    "shift_threshold",
    "key_rate",
)
#: A sample's row of plant coefficients: phi, rho, psi, phi gamma, psi gamma, viscous (2),
#: Coulomb (2), Coulomb velocity.
N_COEFFICIENTS = 10
#: A step's event, see `equations/hybrid.py`: kind, number, branch, root, slope, slot.
N_EVENT = 6

# How both engines find events inside a step, see `simulation/events.py` and `roots.py`.
#: An event function this far above 0 is past its event; rounding stays below. Its units: those of
#: sigma for contents and theta, [rad] for state keys.
TIE = 1e-10
#: A slope below this part of the mean slope over the step, or a rise below `FLAT`, is no crossing.
GRAZE = 1e-6
FLAT = 1e-13
#: Width of the difference stencil, and of the last bracket, as parts of the step.
STENCIL = 3e-4
WIDTH = 1e-13
#: Rounding of an event function.
ROUNDING = 2e-16
ITERATIONS = 60


@dataclass(frozen=True)
class Form:
    """Compile-time constants of a kernel; equal forms share one."""

    n_hidden: int
    n_slots: int  # 0: no memory
    attention: str  # "none" without a memory
    keys: str  # "none" without a memory
    always: bool  # reallocation goes on when all slots are in use
    scaled_reset: bool
    coulomb: bool  # the arm has Coulomb friction
    follow_reference: bool
    noise: bool  # on what is measured
    effort: bool  # torque rates and peaks are kept
    hybrid: bool = False  # steps locate events, see equations/hybrid.py

    @property
    def reallocates(self) -> bool:
        """Whether a slot can be reset."""
        return self.attention == "reallocating"


def unfused_part(plant: Plant, controller: Controller, reference: Reference) -> str | None:
    """The first part of a loop that has no fused form, in a few words; None if all have one."""
    parts: list[tuple[object, Container[type]]] = [
        (plant, PLANTS),
        (reference, REFERENCES),
        (controller, CONTROLLERS),
    ]
    if isinstance(controller, MannController):
        parts += [(part, CONTROL_PARTS) for part in controller.children()]
        if controller.memory is not None:
            parts.append((controller.memory.attention, ATTENTIONS))
            parts.append((controller.memory.key_rule, KEY_RULES))
    for part, known in parts:
        if type(part) not in known:
            return f"{type(part).__name__} has no fused form"
    return None


def form_of(
    controller: MannController,
    *,
    coulomb: bool,
    follow_reference: bool,
    noise: bool = False,
    effort: bool = False,
    hybrid: bool = False,
) -> Form:
    """The form of a loop without an `unfused_part`."""
    memory, n_hidden = controller.memory, controller.network.n_hidden
    if memory is None:
        return Form(
            n_hidden, 0, "none", "none", False, True, coulomb, follow_reference, noise, effort
        )
    attention = memory.attention
    name = ATTENTIONS[type(attention)]
    return Form(
        n_hidden=n_hidden,
        n_slots=memory.n_slots,
        attention=name,
        keys=KEY_RULES[type(memory.key_rule)],
        always=getattr(attention, "phase", None) == "always",
        scaled_reset=memory.reset == "scaled",
        coulomb=coulomb,
        follow_reference=follow_reference,
        noise=noise,
        effort=effort,
        hybrid=hybrid,
    )
