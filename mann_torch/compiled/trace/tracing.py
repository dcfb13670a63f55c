"""Traces a function of tensors, and its vector-Jacobian product, into torch.fx graphs.

Everything that depends on torch's internals stands here: `make_fx`, functionalisation, the
decomposition table, and how their failures are told. Tested with torch 2.10 to 2.13 in mind and on
2.13; `tests/compiled/test_tracing.py` holds the canaries. Where tracing fails in another version,
`UntraceableError` is raised and loops run on the torch engine.
"""

from __future__ import annotations

import functools
import logging
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

import torch
from torch import Tensor
from torch.autograd import forward_ad
from torch.fx import GraphModule, Node
from torch.nn.attention import SDPBackend, sdpa_kernel

from ...errors import InterfaceError
from ...telling import explained, quiet
from .choosing import Choosing
from .telling import UntraceableError, source_of

#: A function of tensors to tensors, in flat lists.
Function = Callable[[Sequence[Tensor]], Sequence[Tensor]]
#: torch's tracing is not made for several threads at once.
_LOCK = threading.RLock()
#: Whether a trace notes where its operations come from.
_SOURCES: ContextVar[bool] = ContextVar("sources", default=False)
Found = TypeVar("Found")

#: Decomposed beyond the core operations.
_MORE_NAMES = """
addcmul addcdiv linalg_vector_norm _softmax _softmax_backward_data _log_softmax
_log_softmax_backward_data sigmoid_backward tanh_backward mv addmm addmv square stack norm
diag_embed select_backward slice_backward softplus softplus_backward elu elu_backward silu
silu_backward gelu gelu_backward leaky_relu leaky_relu_backward hardtanh hardtanh_backward
log_sigmoid_forward log_sigmoid_backward mse_loss huber_loss smooth_l1_loss clamp_min clamp_max
lerp logsumexp baddbmm dot vdot index_add unsafe_split rsub std
native_layer_norm_backward trace logit logaddexp nan_to_num index_select masked_fill xlogy
sinc heaviside frac threshold threshold_backward sgn unfold_backward glu tril triu
diagonal_backward roll fill zeros_like ones_like new_zeros new_ones new_full new_empty
take_along_dim cumprod_backward deg2rad rad2deg addmv mish mish_backward
native_group_norm native_group_norm_backward dist native_batch_norm native_batch_norm_backward
"""
_MORE = _MORE_NAMES.split()
#: Kept whole: torch would write them in operations of its own, or round otherwise than it does.
_WHOLE_NAMES = "rsqrt hypot var var_mean linspace logspace eye hardsigmoid_backward"
_WHOLE = _WHOLE_NAMES.split()


@functools.cache
def _decompositions() -> dict[Any, Callable[..., Any]]:
    from torch._decomp import core_aten_decompositions, get_decompositions

    aten = torch.ops.aten
    packets = [getattr(aten, name) for name in _MORE if hasattr(aten, name)]
    table: dict[Any, Callable[..., Any]] = dict(core_aten_decompositions())
    for packet in packets:
        try:
            table.update(get_decompositions([packet]))
        except (RuntimeError, KeyError):  # this version has none for it
            continue
    whole = [getattr(aten, name) for name in _WHOLE]
    return {k: v for k, v in table.items() if getattr(k, "overloadpacket", None) not in whole}


def _whole(tracer: Any, user_stack_summary: traceback.StackSummary) -> traceback.StackSummary:
    return user_stack_summary


@contextmanager
def _whole_trails() -> Iterator[None]:
    """Let traces note every line on the way to an operation: torch keeps those of `forward`."""
    from torch.fx.proxy import TracerBase

    kept = TracerBase.__dict__.get("_filter_traceback_frames")
    if kept is None:  # another version of torch: fewer lines
        yield
        return
    TracerBase._filter_traceback_frames = _whole  # type: ignore[assignment, method-assign]
    try:
        yield
    finally:
        TracerBase._filter_traceback_frames = kept  # type: ignore[method-assign]


def told(make: Callable[[], Found]) -> Found:
    """What `make` traces; if it can't, once more with source lines, which cost time."""
    try:
        return make()
    except UntraceableError:
        token = _SOURCES.set(True)
        try:
            with _LOCK, _whole_trails():
                return make()
        finally:
            _SOURCES.reset(token)


def trace(function: Function, examples: Sequence[Tensor]) -> GraphModule:
    """The operations of `function`; placeholders and results in the order of its flat lists.

    Raises `UntraceableError`; within `told` it names the source line.
    """

    def cloned(*given: Tensor) -> tuple[Tensor, ...]:
        # A result that is a view of an intermediate would come back as a raw `as_strided`.
        return tuple(found.clone() for found in function(given))

    made = _traced(cloned, examples)
    _check_captured(made, cloned, examples)
    return made


def _check_captured(
    made: GraphModule, function: Callable[..., Any], examples: Sequence[Tensor]
) -> None:
    """Raise `UntraceableError` if a trace holds a tensor that was there before it.

    One that the function makes lies elsewhere when it is traced again.
    """
    held = [
        node
        for node in made.graph.nodes
        if node.op == "get_attr"
        and any("lift_fresh" not in str(user.target) for user in node.users)
    ]
    if not held:
        return
    again = _traced(function, examples)
    known = {
        attribute_of(again, str(node.target)).data_ptr()
        for node in again.graph.nodes
        if node.op == "get_attr"
    }
    for node in held:
        tensor = attribute_of(made, str(node.target))
        if tensor.numel() and tensor.data_ptr() in known:
            raise UntraceableError(
                "a tensor that is neither parameter nor buffer would keep the numbers it has now"
                + source_of(next(iter(node.users)))
            )


def trace_vjp(
    function: Function, examples: Sequence[Tensor], wanted: Sequence[int], outputs: Sequence[int]
) -> GraphModule:
    """Gradients to the inputs numbered `wanted`, from those of the results numbered `outputs`.

    Placeholders: the inputs, then the gradients of the results. Raises `UntraceableError`.
    """
    count, wanted, outputs = len(examples), list(wanted), list(outputs)
    with torch.no_grad():
        results = function(list(examples))
    seeds = [torch.ones_like(results[i]) for i in outputs]

    def back(*given: Tensor) -> tuple[Tensor, ...]:
        inputs, gradients = list(given[:count]), given[count:]

        def forward(*moving: Tensor) -> tuple[Tensor, ...]:
            full = [*inputs]
            for i, value in zip(wanted, moving, strict=True):
                full[i] = value
            found = function(full)
            return tuple(found[i] for i in outputs)

        pull = torch.func.vjp(forward, *(inputs[i] for i in wanted))[1]
        with torch.no_grad():  # nobody differentiates the gradient: torch has shorter formulas
            return pull(tuple(gradients))

    return _traced(back, [*examples, *seeds])


def _traced(function: Callable[..., Any], examples: Sequence[Tensor]) -> GraphModule:
    try:
        with (
            _LOCK,
            torch.random.fork_rng(devices=[]),
            torch.inference_mode(False),
            sdpa_kernel(SDPBackend.MATH),  # attention in operations of its own
            Choosing(),
            quiet("torch._subclasses.fake_tensor", logging.CRITICAL),  # told once, by us
        ):
            made = _pure(function, examples)
            if any(map(_changes_operand, made.graph.nodes)):
                # Left by what torch itself is made of, below functionalisation.
                with torch.fx.traceback.preserve_node_meta():
                    made = _pure(torch.fx.Interpreter(made).run, examples)
    except (UntraceableError, InterfaceError):
        raise
    except Exception as error:  # of many kinds, few of them documented
        raise UntraceableError(explained(error)) from error
    return made


def _pure(function: Callable[..., Any], examples: Sequence[Tensor]) -> GraphModule:
    """One trace, without operations in place on what the function is given or makes itself."""
    from torch.fx.experimental.proxy_tensor import make_fx

    return make_fx(
        torch.func.functionalize(function, remove="mutations"),
        _decompositions(),
        tracing_mode="fake",
        _allow_non_fake_inputs=True,
        record_stack_traces=_SOURCES.get(),
    )(*(example.detach() for example in examples))


def _changes_operand(node: Node) -> bool:
    schema = getattr(node.target, "_schema", None)
    return schema is not None and schema.is_mutable


def attribute_of(made: GraphModule, name: str) -> Tensor:
    """A constant tensor that the trace created."""
    value: Any = made
    for part in name.split("."):
        value = getattr(value, part)
    return value


@contextmanager
def with_tensors(module: torch.nn.Module, tensors: Mapping[str, Tensor]) -> Iterator[None]:
    """Let a module's parameters and buffers, by dotted name, be these tensors for a while."""
    from torch.nn.utils.stateless import _reparametrize_module

    with _reparametrize_module(module, dict(tensors)):
        yield


def transformed() -> bool:
    """Whether torch.func or forward-mode differentiation is at work."""
    return bool(torch._C._are_functorch_transforms_active() or forward_ad._current_level >= 0)
