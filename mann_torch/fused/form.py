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
    RelaxedAttention,
    RepresentationKeys,
    SoftAttention,
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
    SoftAttention: "soft",
    HardAttention: "hard",
    ReallocatingAttention: "reallocating",
    RelaxedAttention: "relaxed",
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
    "temperature",
)
#: A sample's row of plant coefficients: phi, rho, psi, phi gamma, psi gamma, viscous (2),
#: Coulomb (2), Coulomb velocity.
N_COEFFICIENTS = 10


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

    @property
    def reallocates(self) -> bool:
        """Whether a slot can be reset."""
        return self.attention in ("reallocating", "relaxed_reallocating")

    @property
    def relaxed(self) -> bool:
        """Whether slots have activity levels, which carry gradients from step to step."""
        return self.attention.startswith("relaxed")


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
) -> Form:
    """The form of a loop without an `unfused_part`."""
    memory, n_hidden = controller.memory, controller.network.n_hidden
    if memory is None:
        return Form(
            n_hidden, 0, "none", "none", False, True, coulomb, follow_reference, noise, effort
        )
    attention = memory.attention
    name = ATTENTIONS[type(attention)]
    if isinstance(attention, RelaxedAttention):
        name += "_reallocating" if attention.reallocates else "_hard"
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
    )
