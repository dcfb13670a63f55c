"""Sines and sums of them: closed forms."""

import math

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import Sinusoid, Sinusoids

T = torch.linspace(0.0, 9.0, 40, dtype=torch.float64)


def test_five_members_in_closed_form() -> None:
    sample = Sinusoid([0.4], [2.0], [0.1])(T)
    waves = [torch.sin(2.0 * T), torch.cos(2.0 * T), -torch.sin(2.0 * T), -torch.cos(2.0 * T)]
    for k, part in enumerate(sample.upto(4)):
        wanted = 0.4 * 2.0**k * waves[k % 4] + (0.1 if k == 0 else 0.0)
        torch.testing.assert_close(part[:, 0], wanted, rtol=0, atol=1e-14)
    value = Sinusoid([1.0, 0.4], [0.5, 2.0], [0.0, 0.1])(torch.tensor(1.3).double()).value
    assert value[1].item() == pytest.approx(0.1 + 0.4 * math.sin(2.6), abs=1e-7)


def test_one_term_without_phase_is_the_sinusoid() -> None:
    one = Sinusoids([[1.0, 0.4]], [[0.5, 2.0]], offset=[0.0, 0.1])(T)
    sine = Sinusoid([1.0, 0.4], [0.5, 2.0], [0.0, 0.1])(T)
    for mine, theirs in zip(one.upto(4), sine.upto(4), strict=True):
        assert torch.equal(mine, theirs)


def test_phases_and_sums_follow_the_addition_theorem() -> None:
    """sin(wt + a) = cos a sin wt + sin a cos wt: the second term a quarter ahead."""
    a = 0.7
    ahead = Sinusoids([[1.0]], [[3.0]], [[a]])(T)
    quarter = [[0.0], [math.pi / 2]]
    both = Sinusoids([[math.cos(a)], [math.sin(a)]], [[3.0]], quarter)(T)
    for k, (mine, theirs) in enumerate(zip(ahead.upto(4), both.upto(4), strict=True)):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-14 * 3.0**k)


def test_references_of_slotine_and_li_start_at_rest() -> None:
    """Problem 3: (30, 45 degrees)(1 - cos 2 pi t)."""
    size = torch.tensor([math.pi / 6, math.pi / 4], dtype=torch.float64)
    wave = Sinusoids(-size.unsqueeze(0), 2 * math.pi, math.pi / 2, size)
    sample = wave(torch.tensor([0.0, 0.5], dtype=torch.float64))
    assert sample.rate is not None
    torch.testing.assert_close(sample.value, torch.stack([0 * size, 2 * size]), rtol=0, atol=1e-15)
    torch.testing.assert_close(sample.rate, torch.zeros(2, 2).double(), rtol=0, atol=1e-14)


def test_bad_arguments_are_named() -> None:
    with pytest.raises(mt.ConfigError, match="reference amplitude"):
        Sinusoid([float("nan"), 0.0])
    with pytest.raises(mt.ShapeError, match="reference shapes do not broadcast: amplitude"):
        Sinusoid([1.0, 2.0], [1.0, 2.0, 3.0])
    with pytest.raises(mt.ShapeError, match="reference: give at least one"):
        Sinusoid(1.0)
    with pytest.raises(mt.ShapeError, match="Sinusoids amplitude has shape"):
        Sinusoids([1.0], 2.0)
    with pytest.raises(mt.ShapeError, match=r"Sinusoids offset has shape \(3,\): give \(\.\.\., 2"):
        Sinusoids([[1.0, 2.0]], 2.0, 0.0, [1.0, 2.0, 3.0])
    with pytest.raises(mt.DtypeError, match="Sinusoids phase"):
        Sinusoids([[1.0]], 2.0, torch.zeros(1))
