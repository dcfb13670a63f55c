"""What every task is: batches of sequences, a loss to learn by, a score to be judged by."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor, nn


class Batch(NamedTuple):
    """Sequences, time first; `valid` is None where all are equally long."""

    x: Tensor  # (T, B, I) float32
    target: Tensor  # (T, B) a class (int64) or a number
    asked: Tensor  # (T, B) bool: the steps whose answers are learned
    judged: Tensor  # (T, B) bool: those that count in the score
    valid: Tensor | None  # (T, B) bool, False after a sequence's end


class Task(ABC):
    """A source of sequences, and what answers to them are worth."""

    n_inputs: int
    n_outputs: int
    #: What the score is called, and whether less of it is better.
    measure: ClassVar[str]
    lower_is_better: ClassVar[bool]

    @abstractmethod
    def draw(self, count: int, generator: torch.Generator) -> Batch:
        """New sequences."""

    @abstractmethod
    def loss(self, outputs: Tensor, batch: Batch) -> Tensor:
        """() of outputs (T, B, O)."""

    @abstractmethod
    def score(self, outputs: Tensor, batch: Batch) -> float:
        """Of outputs (T, B, O)."""

    @abstractmethod
    def is_perfect(self, score: float) -> bool:
        """Whether nothing is left to learn."""

    @abstractmethod
    def known(self, batch: Batch) -> dict[str, float]:
        """Scores of answers that need no learning, by what they are."""

    def labels(self, batch: Batch, member: int) -> list[str]:
        """What each step of one sequence shows or asks, for a picture."""
        asked = batch.asked[:, member].tolist()
        return ["?" if mark else "" for mark in asked]


class Classification(Task):
    """Answers are classes, the score is the part that is right."""

    measure = "accuracy"
    lower_is_better = False

    def loss(self, outputs: Tensor, batch: Batch) -> Tensor:
        """Cross entropy [nat]."""
        return nn.functional.cross_entropy(outputs[batch.asked], batch.target[batch.asked])

    def score(self, outputs: Tensor, batch: Batch) -> float:
        """Accuracy."""
        right = outputs.argmax(dim=-1) == batch.target
        score = float(right[batch.judged].double().mean())
        return score if bool(torch.isfinite(outputs).all()) else float("nan")

    def is_perfect(self, score: float) -> bool:
        """All right."""
        return score == 1.0

    def known(self, batch: Batch) -> dict[str, float]:
        """Guessing."""
        return {"guessing": 1.0 / self.n_outputs}


class Regression(Task):
    """Answers are numbers, the score is the RMSE in parts of their RMS."""

    measure = "relative RMSE"
    lower_is_better = True
    n_outputs = 1

    def loss(self, outputs: Tensor, batch: Batch) -> Tensor:
        """Mean squared error."""
        error = outputs.squeeze(-1) - batch.target
        return error[batch.asked].square().mean()

    def score(self, outputs: Tensor, batch: Batch) -> float:
        """RMSE over the RMS of what was to be answered."""
        return relative(outputs.squeeze(-1), batch)

    def is_perfect(self, score: float) -> bool:
        """Never: a number can always be nearer."""
        return False

    def known(self, batch: Batch) -> dict[str, float]:
        """Answering 0."""
        return {"answering 0": 1.0}


def relative(answers: Tensor, batch: Batch) -> float:
    """RMSE of answers (T, B) in parts of the targets' RMS, at the steps that are judged."""
    wanted = batch.target[batch.judged].double()
    error = answers[batch.judged].double() - wanted
    return float((error.square().mean() / wanted.square().mean()).sqrt())


def one_hot(symbols: Tensor, count: int) -> Tensor:
    """float32 (..., count) of int64 (...)."""
    return nn.functional.one_hot(symbols, count).float()
