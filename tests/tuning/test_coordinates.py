"""Coordinates keep every constant in its domain, wherever they go."""

import math

import pytest
import torch

import mann_torch as mt
from mann_torch.tuning import FORMS, Coordinates
from tests.conftest import make_controller, randn

NAMES = ["write_gain", "error_gain", "rate_W", "shift_threshold"]


@pytest.mark.parametrize("form", FORMS)
def test_zero_is_the_start_and_all_else_is_inside(form: str) -> None:
    controller = make_controller("reallocating_initial")
    controller.initialize(error_gain=[[5.0, 0.4], [0.4, 3.0]])
    coordinates = Coordinates(controller, NAMES, form)
    assert (
        coordinates.size
        == len(coordinates.labels)
        == 3 + {"scalar": 1, "diagonal": 2, "full": 3}[form]
    )
    zero = torch.zeros(coordinates.size, dtype=torch.float64)
    for name, value in coordinates.values(zero).items():
        assert torch.allclose(value, controller.constant(name), rtol=1e-14)
    for seed in range(20):
        values = coordinates.values(3.0 * randn(4, coordinates.size, seed=seed))
        assert values["error_gain"].shape == (4, 2, 2) and values["rate_W"].shape == (4,)
        controller.initialize(**values)  # checks every domain


def test_a_scalar_moves_by_its_logarithm_and_a_matrix_as_a_whole() -> None:
    controller = make_controller("hard")
    coordinates = Coordinates(controller, ["rate_V", "error_gain"])
    z = torch.log(torch.tensor([1.1, 0.7], dtype=torch.float64))
    values = coordinates.values(z)
    assert torch.allclose(values["rate_V"], 1.1 * controller.constant("rate_V"))
    assert torch.allclose(values["error_gain"], 0.7 * controller.constant("error_gain"))


def test_a_row_moves_number_by_number_and_keeps_its_signs() -> None:
    controller = mt.LinearFeedback([[4.0, -2.0]], [[0.0]])
    z = torch.log(torch.tensor([1.5, 0.5], dtype=torch.float64))
    for form, moved in (("scalar", z[:1]), ("diagonal", z)):
        coordinates = Coordinates(controller, ["feedback"], form)
        assert coordinates.size == len(moved) == len(coordinates.labels)
        value = coordinates.values(moved)["feedback"]
        assert torch.allclose(value, moved.exp() * controller.constant("feedback"))
    with pytest.raises(mt.ConfigError, match="can't be tuned from 0"):
        Coordinates(controller, ["feedforward"])


def test_full_form_reaches_any_symmetric_positive_definite_matrix() -> None:
    controller = make_controller("hard")
    coordinates = Coordinates(controller, ["error_gain"], "full")
    wanted = torch.tensor([[4.0, -1.5], [-1.5, 2.0]], dtype=torch.float64)
    S = torch.linalg.cholesky(wanted) / 5.0**0.5  # S 5I S' = wanted
    z = torch.stack([2 * S[0, 0].log(), 2 * S[1, 1].log(), S[1, 0]])
    assert torch.allclose(coordinates.values(z)["error_gain"], wanted)


@pytest.mark.parametrize(
    ("names", "form", "said"),
    [
        ([], "scalar", "no constant"),
        (["c_w"], "scalar", "no design constant 'c_w'"),
        (["rate_W", "rate_W"], "scalar", "each once"),
        (["e_modification"], "scalar", "can't be tuned from 0"),
        (["rate_W"], "cubic", "matrix form"),
    ],
)
def test_what_cannot_be_tuned_is_a_named_error(names: list[str], form: str, said: str) -> None:
    with pytest.raises(mt.ConfigError, match=said):
        Coordinates(make_controller("hard"), names, form)


def test_a_constant_of_each_sample_is_not_tuned_as_one() -> None:
    controller = make_controller("hard")
    controller.initialize(rate_W=[1.0, 2.0])
    with pytest.raises(mt.ConfigError, match="batch shape"):
        Coordinates(controller, ["rate_W"])


def test_a_row_with_zeros_keeps_them() -> None:
    feedback = mt.LinearFeedback([[0.0, -4.0]])
    for form, z in (("scalar", [0.5]), ("diagonal", [0.5, 0.5])):
        coordinates = Coordinates(feedback, ["feedback"], form)
        (row,) = coordinates.values(torch.tensor(z, dtype=torch.float64)).values()
        assert row.tolist() == [0.0, -4.0 * math.exp(0.5)]
    with pytest.raises(mt.ConfigError, match="can't be tuned from 0"):
        Coordinates(mt.LinearFeedback([[0.0, 0.0]]), ["feedback"])


def test_a_row_of_any_numbers_moves_freely_in_full_form() -> None:
    controller = mt.control.LinearFeedback([[0.0, -4.0, 3.0, 0.0]], offset=0.0)
    coordinates = Coordinates(controller, ["feedback", "offset"], "full")
    assert coordinates.size == 5 and coordinates.labels[1] == "feedback[1]"
    z = torch.tensor([1.0, 2.0, -4.0, 0.0, -3.0], dtype=torch.float64)
    values = coordinates.values(z)
    assert values["feedback"].tolist() == [2.5, 1.0, -7.0, 0.0]  # the RMS is 2.5
    assert values["offset"].tolist() == [-3.0]
