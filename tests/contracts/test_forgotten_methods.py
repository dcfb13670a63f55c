"""An interface names what a part of one's own forgot, and what it is for."""

from __future__ import annotations

import pytest

from mann_torch import control, memory, parts, plants, signals, simulation
from mann_torch.control.adaptive_controller import AdaptiveController
from mann_torch.control.l1 import L1Adaptation
from mann_torch.control.saturation.deficit import Deficit
from mann_torch.domains import Domain, Row
from mann_torch.errors import InterfaceError
from mann_torch.interface import Interface

#: Each interface, one of its methods, and a word of what that is for.
INTERFACES: dict[type, tuple[str, str]] = {
    plants.Plant: ("derivative", "derivative of the state"),
    plants.MechanicalPlant: ("mass_matrix", r"M\(q\)"),
    signals.Reference: ("at", "derivatives"),
    control.Controller: ("forward", r"Input \(\.\.\., m\)"),
    AdaptiveController: ("look", "What is seen"),
    control.Law: ("forward", "d theta/dt"),
    control.Gain: ("applied", "Gamma x"),
    control.Leak: ("forward", "c >= 0"),
    control.Term: ("forward", "added to Phi s"),
    control.Gate: ("forward", "less of an error"),
    control.Guard: ("forward", "let through"),
    control.FeatureNetwork: ("features", "Features sigma"),
    control.Basis: ("forward", "phi"),
    control.Labels: ("pair", "The regression"),
    control.Saturation: ("rates", "d state/dt"),
    control.NetworkInputs: ("forward", "x~"),
    L1Adaptation: ("rates", "Time derivative"),
    memory.Attention: ("decide_shift", "reset a slot"),
    memory.KeyRule: ("fresh_keys", "written anew"),
    parts.ReferenceModel: ("rates", "Time derivative"),
    simulation.Solver: ("step", r"y\(t \+ h\)"),
    Domain: ("contains", "lies in the domain"),
    Row: ("contains", "lies in the domain"),
}
every = pytest.mark.parametrize("interface", INTERFACES, ids=lambda kind: kind.__name__)


@every
def test_a_class_without_its_methods_is_not_made(interface: type) -> None:
    method, purpose = INTERFACES[interface]
    mine = type("Mine", (interface,), {})
    with pytest.raises(InterfaceError, match=rf"^Mine lacks .*\b{method}\b.*{purpose}"):
        mine()


@every
def test_the_one_that_is_forgotten_is_named_alone(interface: type) -> None:
    method, _ = INTERFACES[interface]
    others = {*interface.__abstractmethods__, *getattr(interface, "required", ())} - {method}
    rest = dict.fromkeys(others, lambda self: None)
    with pytest.raises(InterfaceError, match=rf"^Mine lacks {method} \({method}: "):
        type("Mine", (interface,), rest)()


def test_no_interface_of_the_library_is_left_out() -> None:
    assert _abstract(Interface) - {Deficit} == set(INTERFACES)  # which is not made by its name


def _abstract(kind: type) -> set[type]:
    """Interfaces of the library below one, at any depth."""
    found = set()
    for each in kind.__subclasses__():
        if each.__module__.startswith("mann_torch"):
            found |= _abstract(each) | ({each} if each.__abstractmethods__ else set())
    return found
