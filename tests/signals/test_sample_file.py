"""Samples read from files, and every way a file can be wrong."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.errors import ReferenceFileError
from mann_torch.signals import Spline

T = np.array([0.0, 0.5, 2.0, 3.0])
COLUMNS = {"t": T, "hip": np.sin(T), "knee": np.cos(T)}


def csv(*lines: str) -> Callable[[Path], None]:
    return lambda path: path.with_suffix(".csv").write_text("\n".join(lines) + "\n") and None


def npz(**columns: object) -> Callable[[Path], None]:
    return lambda path: np.savez(path.with_suffix(".npz"), **columns)  # type: ignore[arg-type]


def test_both_formats_give_the_spline_of_their_numbers(tmp_path: Path) -> None:
    rows = [", ".join(map(repr, row)) for row in np.stack(list(COLUMNS.values()), -1).tolist()]
    csv("t, hip, knee", *rows, "")(tmp_path / "a")
    npz(**COLUMNS)(tmp_path / "a")
    wanted = Spline(torch.from_numpy(T), torch.from_numpy(np.stack([np.sin(T), np.cos(T)], -1)))
    t = torch.linspace(-1.0, 4.0, 30, dtype=torch.float64)
    for name in ("a.csv", "a.npz"):
        found = Spline.from_file(tmp_path / name)
        assert found.width == 2 and torch.equal(found(t).value, wanted(t).value)
    smoother = Spline.from_file(str(tmp_path / "a.npz"), degree=5, ends="clamped")
    assert smoother.order == 4 and torch.equal(smoother(t[:1]).value[0], wanted(t[:1]).value[0])


def test_a_heading_of_a_spreadsheet_and_whole_numbers_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("﻿t,x\r\n0,1\r\n1,2\r\n".encode())
    npz(t=np.array([0, 1]), x=np.array([1, 2], dtype=np.int32))(tmp_path / "a")
    for name in ("a.csv", "a.npz"):
        half = torch.tensor(0.5, dtype=torch.float64)
        assert Spline.from_file(tmp_path / name)(half).value.tolist() == [1.5]


WRONG: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "missing": ("a.csv", lambda path: None, "does not exist"),
    "a folder": ("a.csv", lambda path: path.with_suffix(".csv").mkdir(), "does not exist"),
    "another kind": ("a.txt", lambda path: path.with_suffix(".txt").touch(), "give a .csv or .npz"),
    "empty": ("a.csv", csv(""), "needs a column t and one per output, has none"),
    "no time": ("a.csv", csv("x,y", "0,1", "1,2"), "needs a column t .*, has x, y"),
    "no output": ("a.csv", csv("t", "0", "1"), "needs a column t and one per output, has t"),
    "one row": ("a.csv", csv("t,x", "0,1"), "1 rows: at least 2"),
    "no row": ("a.csv", csv("t,x"), "0 rows: at least 2"),
    "a word": ("a.csv", csv("t,x", "0,1", "1,far"), "cannot be read: .*far"),
    "ragged": ("a.csv", csv("t,x", "0,1", "1"), "cannot be read: row 2 has 1 numbers"),
    "twice": ("a.csv", csv("t,x,x", "0,1,1", "1,1,1"), "two columns of one name"),
    "unsorted": ("a.csv", csv("t,x", "0,1", "2,1", "1,1"), "times must increase: row 3"),
    "equal times": ("a.npz", npz(t=[0.0, 0.0], x=[1.0, 1.0]), "times must increase: row 2"),
    "nan": ("a.csv", csv("t,x", "0,1", "1,nan"), "column x: row 2 is not finite"),
    "inf": ("a.npz", npz(t=[0.0, np.inf], x=[1.0, 1.0]), "column t: row 2 is not finite"),
    "unlike": ("a.npz", npz(t=[0.0, 1.0], x=[1.0]), "column x has shape .1,., t has .2,."),
    "a matrix": ("a.npz", npz(t=[0.0, 1.0], x=np.ones((2, 2))), "column x has shape .2, 2."),
    "words": ("a.npz", npz(t=[0.0, 1.0], x=["a", "b"]), "column x is of type <U1"),
    "pickled": ("a.npz", npz(t=[0.0, 1.0], x=np.array([None, 1])), "cannot be read: .*pickle"),
    "no zip": ("a.npz", lambda path: path.with_suffix(".npz").write_bytes(b"x" * 99), "cannot be"),
    "bytes": (
        "a.csv",
        lambda path: path.with_suffix(".csv").write_bytes(b"\xff\xfe\x00"),
        "cannot",
    ),
    "an array": (
        "a.npz",
        lambda path: np.save(path.with_suffix(".npz").open("wb"), np.ones(3)),
        "cannot be read: no .npz file",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_a_file_is_named(name: str, tmp_path: Path) -> None:
    file, write, words = WRONG[name]
    write(tmp_path / "a")
    with pytest.raises(ReferenceFileError, match=rf"reference file '.*{file}'.* ?{words}"):
        Spline.from_file(tmp_path / file)


def test_too_few_for_the_degree_names_the_file(tmp_path: Path) -> None:
    npz(t=[0.0, 1.0], x=[1.0, 2.0])(tmp_path / "a")
    with pytest.raises(ReferenceFileError, match=r"a\.npz': .*at least 3 times"):
        Spline.from_file(tmp_path / "a.npz", degree=5)
    with pytest.raises(mt.KindError, match="path = 3"):
        Spline.from_file(3)  # type: ignore[arg-type]
