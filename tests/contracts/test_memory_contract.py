"""What every attention with every key rule must do. A new one is a line in the lists."""

import pytest
import torch

import mann_torch as mt
from mann_torch.memory import ATTENTIONS, KEY_RULES
from mann_torch.testing import check_attention
from mann_torch.trees import leaves, map_tensors
from mann_torch.types import MemoryState
from tests.conftest import ATTENTION_MAKERS, make_attention, randn

B, S, N, C = 64, 5, 6, 2
ATTENTION_NAMES = tuple(ATTENTION_MAKERS)
DECIDING = tuple(name for name in ATTENTION_NAMES if not name.startswith("relaxed"))


def paired(names: tuple[str, ...]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize(
        ("attention", "rule"), [(a, r) for a in names for r in KEY_RULES]
    )


pairs = paired(ATTENTION_NAMES)


def test_every_registered_attention_is_under_contract() -> None:
    covered = {type(make_attention(name)) for name in ATTENTION_NAMES}
    assert covered == {*ATTENTIONS.values(), mt.RelaxedAttention}


def setup(attention: str, rule: str) -> tuple[mt.WorkingMemory, tuple]:
    memory = mt.WorkingMemory(S, N, make_attention(attention), KEY_RULES[rule](), context_width=C)
    width = memory.key_rule.width(C)
    state = MemoryState(0.4 * randn(B, S, N), randn(B, S, width, seed=1))
    drawn = torch.rand(B, S, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    active = drawn < 0.6
    if memory.attention.graded:
        active = drawn.lerp(torch.ones_like(drawn), 0.3) * active
    active[:, 0] = True
    mode = memory.initial_mode((B,))._replace(active=active)
    hidden = torch.sigmoid(randn(B, N, seed=3))
    return memory, (hidden, 0.1 * randn(B, N, seed=4), randn(B, C, seed=5), state, mode)


@pairs
def test_the_attention_keeps_its_contract(attention: str, rule: str) -> None:
    check_attention(make_attention(attention), KEY_RULES[rule]())


@pairs
def test_slot_permutation_permutes_the_weights(attention: str, rule: str) -> None:
    memory, (hidden, correction, context, state, mode) = setup(attention, rule)
    order = torch.tensor([3, 0, 4, 1, 2])
    shuffled = MemoryState(state.mu[:, order], state.keys[:, order])
    out = memory(hidden, correction, context, state, mode)
    other = memory(
        hidden, correction, context, shuffled, mode._replace(active=mode.active[:, order])
    )
    torch.testing.assert_close(other.weights, out.weights[:, order], rtol=0, atol=1e-14)
    torch.testing.assert_close(other.read, out.read, rtol=0, atol=1e-13)
    for mine, theirs in zip(out.d_memory, other.d_memory, strict=True):
        torch.testing.assert_close(theirs, mine[:, order], rtol=0, atol=1e-13)


@pairs
def test_batch_equals_single_calls(attention: str, rule: str) -> None:
    memory, (hidden, correction, context, state, mode) = setup(attention, rule)
    out = memory(hidden, correction, context, state, mode)
    jumped, jumped_mode = memory.jump(hidden, context, state, mode)
    for i in range(0, B, 7):
        state_i = MemoryState(state.mu[i], state.keys[i])
        mode_i = map_tensors(lambda leaf, i=i: leaf[i], mode)
        one = memory(hidden[i], correction[i], context[i], state_i, mode_i)
        torch.testing.assert_close(one.read, out.read[i], rtol=0, atol=1e-12)
        torch.testing.assert_close(one.d_memory.mu, out.d_memory.mu[i], rtol=0, atol=1e-12)
        alone, alone_mode = memory.jump(hidden[i], context[i], state_i, mode_i)
        torch.testing.assert_close(alone.mu, jumped.mu[i], rtol=0, atol=1e-12)
        assert alone_mode.active.dtype == mode.active.dtype
        torch.testing.assert_close(alone_mode.active, jumped_mode.active[i], rtol=0, atol=1e-12)


@paired(DECIDING)
def test_jump_changes_at_most_one_slot_and_only_where_counted(attention: str, rule: str) -> None:
    memory, (hidden, _, context, state, mode) = setup(attention, rule)
    after, after_mode = memory.jump(hidden, context, state, mode)
    changed = (after.mu != state.mu).any(-1).sum(-1)
    resets = after_mode.reallocations - mode.reallocations
    assert bool((changed <= 1).all())
    assert torch.equal(changed, resets)


@pairs
def test_gradients_reach_features_contents_and_write_gain(attention: str, rule: str) -> None:
    memory, (hidden, correction, context, state, mode) = setup(attention, rule)
    constants = dict(zip(memory.constants(), memory.tune(*memory.constants()), strict=True))
    hidden = hidden.requires_grad_()
    state = MemoryState(state.mu.requires_grad_(), state.keys)
    out = memory(hidden, correction, context, state, mode)
    loss = out.read.square().sum() + out.d_memory.mu.square().sum()
    gradients = torch.autograd.grad(loss, [constants["write_gain"], hidden, state.mu])
    assert all(bool(torch.isfinite(g).all()) and bool((g != 0).any()) for g in gradients)
    jumped, _ = memory.jump(hidden, context, state, mode)
    loss = memory(hidden, correction, context, jumped, mode).read.square().sum()
    every = torch.autograd.grad(loss, list(constants.values()), allow_unused=True)
    for name, gradient in zip(constants, every, strict=True):  # unused slots leak no NaN
        assert gradient is None or bool(torch.isfinite(gradient).all()), name


@pairs
def test_wrong_shapes_and_dtypes_are_named_errors(attention: str, rule: str) -> None:
    memory, (hidden, correction, context, state, mode) = setup(attention, rule)
    with pytest.raises(mt.ShapeError, match="features has shape"):
        memory.initial_state(hidden[:, :-1], context)
    with pytest.raises(mt.ShapeError, match="features has shape"):
        memory(hidden[:, :-1], correction, context, state, mode)
    with pytest.raises(mt.ShapeError, match="mu has shape"):
        memory.jump(hidden, context, state._replace(mu=state.mu[:, 1:]), mode)
    with pytest.raises(mt.ShapeError, match="context"):
        memory(hidden, correction, context[:, :-1], state, mode)
    for name, place in (("features", 0), ("correction", 1), ("context", 2)):
        arguments = [hidden, correction, context, state, mode]
        arguments[place] = arguments[place].float()
        with pytest.raises(mt.DtypeError, match=f"{name} is torch.float32"):
            memory(*arguments)
    for name in ("mu", "keys"):
        wrong = state._replace(**{name: getattr(state, name).float()})
        with pytest.raises(mt.DtypeError, match=f"{name} is torch.float32"):
            memory.jump(hidden, context, wrong, mode)
    with pytest.raises(mt.ShapeError, match="keys has shape"):
        memory.jump(
            hidden, context, state._replace(keys=torch.cat([state.keys] * 2 + [state.mu], -1)), mode
        )
    with pytest.raises(mt.ShapeError, match="correction has shape"):
        memory(hidden, correction[:, :1], context, state, mode)
    with pytest.raises(mt.ShapeError, match="active has shape"):
        memory(hidden, correction, context, state, mode._replace(active=mode.active[:, 1:]))
    with pytest.raises(mt.ShapeError, match=r"batch shapes do not fit: features \(63,\)"):
        memory(hidden[1:], correction, context, state, mode)


@pairs
def test_float_and_half_leave_the_memory_in_float64(attention: str, rule: str) -> None:
    memory, arguments = setup(attention, rule)
    read = memory(*arguments).read
    holder = torch.nn.ModuleList([memory]).float().half()
    assert torch.equal(memory(*arguments).read, read)
    holder.load_state_dict(holder.state_dict())


@pairs
def test_state_dict_round_trip(attention: str, rule: str) -> None:
    memory, arguments = setup(attention, rule)
    memory.initialize(write_gain=0.6)
    memory.store_(MemoryState(arguments[3].mu[0], arguments[3].keys[0]), arguments[4].active[0])
    twin = setup(attention, rule)[0]
    before = dict(twin.named_parameters())
    twin.load_state_dict(memory.state_dict())
    assert all(before[name] is value for name, value in twin.named_parameters())
    start, mode = (m.initial_state(*arguments[:3:2]) for m in (memory, twin)), twin.initial_mode(())
    for mine, other in zip(*start, strict=True):
        assert torch.equal(mine, other)
    assert torch.equal(mode.active, memory.initial_mode(()).active)
    out, again = memory(*arguments), twin(*arguments)
    assert torch.equal(out.read, again.read) and torch.equal(out.d_memory.mu, again.d_memory.mu)


@pairs
def test_export_parity(attention: str, rule: str) -> None:
    memory, arguments = setup(attention, rule)
    exported = torch.export.export(memory, arguments).module()
    other = map_tensors(lambda leaf: leaf.flip(0), arguments[3])
    for case in (arguments, (*arguments[:3], other, arguments[4])):
        for mine, theirs in zip(leaves(memory(*case)), leaves(exported(*case)), strict=True):
            torch.testing.assert_close(theirs, mine, rtol=0, atol=1e-14)
