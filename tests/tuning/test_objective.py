"""What is minimised, where inputs stand still."""

import torch

from mann_torch.tuning import Objective, Score


def test_inputs_that_stand_still_at_the_start_cost_nothing_later() -> None:
    still = Score(*torch.tensor([[1.0], [0.0], [0.0]], dtype=torch.float64))
    numbers = torch.tensor([[0.5], [3.0], [2.0]], dtype=torch.float64, requires_grad=True)
    worth = Objective(effort_weight=0.3)(Score(*numbers), still)
    (slope,) = torch.autograd.grad(worth.sum(), numbers)
    assert worth.tolist() == [0.5]
    assert slope.flatten().tolist() == [1.0, 0.0, 0.0]
