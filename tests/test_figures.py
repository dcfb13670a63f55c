"""The picture of a memory at work."""

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.utils.tensorboard import SummaryWriter

import mann_torch as mt
from tests.conftest import make_attention, randn


@pytest.fixture
def trace() -> mt.memory.MemoryTrace:
    torch.manual_seed(0)
    cell = mt.MemoryCell.paper(3, 6, 4, make_attention("reallocating_always"), dtype=torch.float64)
    return mt.MemorySequence(cell).trace(4 * randn(40, 2, 3))


def test_it_shows_weights_contents_and_resets_of_the_member(trace: mt.memory.MemoryTrace) -> None:
    run = trace.member(1)
    top, bottom = mt.memory_figure({"cell": run}).axes[:2]
    np.testing.assert_array_equal(top.images[0].get_array(), run["weights"].T)
    np.testing.assert_array_equal(bottom.images[0].get_array(), run["mu"].reshape(40, -1).T)
    step, slot = mt.memory.reallocation_log(trace, 1).values()
    (resets,) = top.lines
    np.testing.assert_array_equal(resets.get_xydata(), np.stack([step, slot + 1], axis=-1))
    assert len(step) > 0


def test_an_attention_that_never_resets_needs_no_resets(trace: mt.memory.MemoryTrace) -> None:
    run = {name: rows for name, rows in trace.member(1).items() if name != "reset"}
    top = mt.memory_figure({"cell": run}).axes[0]
    assert not top.lines and top.get_title() == "cell: attention"
    with pytest.raises(mt.ConfigError, match="each with `weights` and `mu`"):
        mt.memory_figure({"cell": {"mu": run["mu"]}})


def test_steps_that_were_not_taken_are_blank() -> None:
    x = randn(12, 2, 3).float()
    trace = mt.MemorySequence(mt.MemoryCell(3, 6, 4)).trace(x, lengths=[12, 5])
    top, bottom = mt.memory_figure({"cell": trace.member(1)}).axes[:2]
    for ax in (top, bottom):
        assert ax.images[0].get_array().mask.all(0).tolist() == [False] * 5 + [True] * 7
        assert not ax.images[0].get_array().mask[:, :5].any()


def test_a_member_without_a_name_is_told_to_have_one(trace: mt.memory.MemoryTrace) -> None:
    for given in (trace.member(1), trace, {"cell": trace}):
        with pytest.raises(mt.KindError, match=r'\{"name": trace\.member\(i\)\}'):
            mt.memory_figure(given)


@pytest.mark.parametrize("count", [1, 3, 4])
def test_every_memory_has_its_place(trace: mt.memory.MemoryTrace, count: int) -> None:
    runs = {f"memory {i}": trace.member(i % 2) for i in range(count)}
    figure = mt.memory_figure(runs, t=0.1 * np.arange(40), marks=[1.0], t_label="t [s]")
    titles = [ax.get_title() for ax in figure.axes if ax.get_title()]
    assert [title.split(":")[0] for title in titles] == list(runs)
    assert len(figure.axes) == 4 * count  # two maps and their colour bars each
    assert sum(ax.get_xlabel() == "t [s]" for ax in figure.axes) == count


def test_tensorboard_takes_it(trace: mt.memory.MemoryTrace, tmp_path: object) -> None:
    with SummaryWriter(str(tmp_path)) as writer:
        writer.add_figure("memory", mt.memory_figure({"cell": trace.member(0)}))
    assert "memory" in EventAccumulator(str(tmp_path)).Reload().Tags()["images"]
