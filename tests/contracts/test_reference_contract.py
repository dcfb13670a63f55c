"""What every reference must do, and that the check of it notices what does not."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.errors import InterfaceError
from mann_torch.signals import REFERENCES, PiecewiseConstant, Reference, Rows
from mann_torch.testing import check_reference
from tests.compiled.marching import Function, Inputs, check_together
from tests.signals.broken_references import BROKEN, Ramp
from tests.signals.references import MAKERS

every = pytest.mark.parametrize("name", MAKERS)


def test_every_reference_of_the_library_is_tried() -> None:
    assert {name.split()[0] for name in MAKERS} - {"constant"} == set(REFERENCES)
    assert {type(make()) for make in MAKERS.values()} == set(REFERENCES.values())


@every
def test_it_keeps_its_contract_alone_and_in_a_batch(name: str) -> None:
    reference = MAKERS[name]()
    check_reference(reference)
    check_reference(reference.expand((2, *reference.batch_shape)), horizon=25.0)


@every
def test_gradients_reach_what_it_is_made_of_in_every_backward_pass(name: str) -> None:
    """Rows are kept as they are given: a loss may be differentiated again."""
    reference = MAKERS[name]()
    for _, owner, row in owners(reference):
        getattr(owner, row).requires_grad_()
    t = torch.linspace(0.1, 7.0, 9, dtype=torch.float64)
    for _ in range(2):
        reference(t).value.square().sum().backward()


@every
def test_saved_rows_are_loaded(name: str) -> None:
    reference, twin = MAKERS[name](), MAKERS[name]()
    state = reference.state_dict()
    t = torch.linspace(0.1, 7.0, 9, dtype=torch.float64)
    twin.load_state_dict({key: 1.01 * rows for key, rows in state.items()}, assign=True)
    assert not torch.equal(twin(t).value, reference(t).value)
    twin.load_state_dict(state, assign=True)
    assert torch.equal(twin(t).value, reference(t).value)


def owners(reference: Reference) -> list[tuple[str, Rows, str]]:
    """Path, owner and name of all rows of a reference."""
    found = [(p, m) for p, m in reference.named_modules() if isinstance(m, Rows)]
    return [(f"{path}.{name}", module, name) for path, module in found for name in module.held()]


def of_rows(label: str, reference: Reference) -> Function:
    """All that a reference gives at a time `t`, its rows among the sample's."""
    twin = reference.expand(reference.batch_shape)

    def function(sample: dict[str, Tensor]) -> Tensor:
        for path, owner, name in owners(twin):
            rows = sample[f"{label} {path}"]
            # The times of jumps have no gradient.
            steps = isinstance(owner, PiecewiseConstant) and name == "times"
            setattr(owner, name, rows.detach() if steps else rows)
        return torch.stack([part for part in twin(sample["t"]).parts if part is not None])

    return function


@pytest.mark.slow
def test_all_of_them_compile_with_values_and_gradients_as_in_torch() -> None:
    scales = torch.tensor([1.0, 1.03, 0.98, 1.1], dtype=torch.float64)
    functions, constants = {}, {}
    for label, make in MAKERS.items():
        reference = make()
        functions[label] = of_rows(label, reference)
        for path, owner, name in owners(reference):
            rows = getattr(owner, name)
            constants[f"{label} {path}"] = scales.reshape(-1, *(1,) * rows.dim()) * rows
    t = torch.tensor([0.3, 1.7, 2.9, 8.0], dtype=torch.float64)
    assert check_together(functions, Inputs(constants, {"t": t})) < 1e-12


def test_a_right_reference_of_ones_own_passes() -> None:
    check_reference(Ramp())
    with pytest.raises(mt.KindError, match="reference = 3"):
        check_reference(3)  # type: ignore[arg-type]
    with pytest.raises(mt.ConfigError, match="horizon"):
        check_reference(Ramp(), horizon=0.0)


@pytest.mark.parametrize("broken", BROKEN, ids=lambda kind: kind.__name__)
def test_what_is_broken_is_named(broken: type[Reference]) -> None:
    with pytest.raises(InterfaceError, match=rf"^{broken.__name__}, contract {BROKEN[broken]}"):
        check_reference(broken())


def test_a_reference_without_at_says_so() -> None:
    class Nothing(Reference):
        pass

    with pytest.raises(InterfaceError, match="Nothing lacks at"):
        Nothing()
