"""Plants that break where joint 1 has moved by `LIMIT`."""

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.plants import NLinkArm

LIMIT = 0.005  # [rad]


def moved(q: Tensor) -> Tensor:
    """Whether joint 1 is beyond it, (..., 1)."""
    return q[..., :1].abs() > LIMIT


class NaNLoad(mt.TwoLinkArm):
    """The right-hand side becomes NaN."""

    def load(self, q: Tensor, qd: Tensor, coefficients: object) -> Tensor:
        return torch.where(moved(q), torch.nan, super().load(q, qd, coefficients))


class InfLoad(mt.TwoLinkArm):
    """The right-hand side becomes infinite."""

    def load(self, q: Tensor, qd: Tensor, coefficients: object) -> Tensor:
        return torch.where(moved(q), torch.inf, super().load(q, qd, coefficients))


class SingularArm(mt.TwoLinkArm):
    """The mass matrix loses its rank."""

    def mass_matrix(self, q: Tensor, coefficients: object) -> Tensor:
        M = super().mass_matrix(q, coefficients)
        return torch.where(moved(q).unsqueeze(-1), torch.ones_like(M), M)


class SingularLinks(NLinkArm):
    """The same of three links, whose systems are solved by LU."""

    def mass_matrix(self, q: Tensor, coefficients: object) -> Tensor:
        M = super().mass_matrix(q, coefficients)
        return torch.where(moved(q).unsqueeze(-1), torch.ones_like(M), M)
