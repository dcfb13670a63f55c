"""The compiler's own graphs: what its constructors make of views, concatenations and numbers."""

from __future__ import annotations

from collections.abc import Sequence

from mann_torch.compiled.cpp.plan import Output, make_plan
from mann_torch.compiled.cpp.reads import stored_nodes
from mann_torch.compiled.graph.arithmetic import pointwise, reduce
from mann_torch.compiled.graph.nodes import Graph, Node, number_of, reachable
from mann_torch.compiled.graph.reshapes import expand, narrow, permute, reshape
from mann_torch.compiled.graph.views import cat


def inputs(g: Graph, *shapes: Sequence[int]) -> list[Node]:
    return [g.input("f", 100 * i, shape, "f") for i, shape in enumerate(shapes)]


def units(*outputs: Node) -> list[str]:
    """Operations that get a value of their own."""
    plan = make_plan([Output(node, "f_out", 10 * i) for i, node in enumerate(outputs)])
    return [node.op for group in plan.groups for node in group.nodes]


def test_equal_nodes_are_one() -> None:
    g = Graph()
    a, b = inputs(g, (3,), (3,))
    assert pointwise(g, "add", [a, b], "f") is pointwise(g, "add", [b, a], "f")
    assert pointwise(g, "sub", [a, b], "f") is not pointwise(g, "sub", [b, a], "f")


def test_a_state_packed_stepped_and_unpacked_costs_no_copies() -> None:
    g = Graph()
    a, b, c, d = inputs(g, (2,), (3,), (2,), (3,))
    packed, rate = cat(g, [a, b], 0), cat(g, [c, d], 0)
    step = pointwise(g, "mul", [g.full(0.1, (), "f"), rate], "f")
    moved = pointwise(g, "add", [packed, step], "f")
    parts = [narrow(g, moved, 0, 0, 2), narrow(g, moved, 0, 2, 3)]
    assert units(*parts) == ["add", "add"]
    assert not any(node.op in ("cat", "view") for node in reachable(parts))


def test_a_reader_of_two_pieces_gets_just_those() -> None:
    g = Graph()
    pieces = inputs(g, (2,), (3,), (4,))
    whole = cat(g, pieces, 0)
    between = narrow(g, whole, 0, 1, 3)
    assert between.op == "cat" and between.shape == (3,)
    assert between.args[0] is narrow(g, pieces[0], 0, 1, 1)
    assert between.args[1] is narrow(g, pieces[1], 0, 0, 2)


def test_slices_put_together_again_are_the_whole() -> None:
    g = Graph()
    (x,) = inputs(g, (2, 5))
    assert cat(g, [narrow(g, x, 1, 0, 2), narrow(g, x, 1, 2, 3)], 1) is x
    swapped = cat(g, [narrow(g, x, 1, 2, 3), narrow(g, x, 1, 0, 2)], 1)
    assert swapped.op == "cat"


def test_views_of_views_are_one_view() -> None:
    g = Graph()
    (x,) = inputs(g, (4, 6))
    turned = permute(g, narrow(g, x, 1, 1, 4, 1), [1, 0])
    back = permute(g, narrow(g, turned, 0, 3, 4, -1), [1, 0])
    assert back.op == "view" and back.args == (x,)
    assert permute(g, permute(g, x, [1, 0]), [1, 0]) is x
    assert narrow(g, narrow(g, x, 1, 5, 6, -1), 1, 5, 6, -1) is x


def test_a_reshape_undone_is_none() -> None:
    g = Graph()
    (x,) = inputs(g, (2, 6))
    flat = pointwise(g, "sin", [reshape(g, x, (12,))], "f")
    back = reshape(g, flat, (2, 6))
    assert back is pointwise(g, "sin", [x], "f")
    assert reshape(g, reshape(g, x, (3, 4)), (2, 6)) is x
    assert reshape(g, x, (2, 1, 2, 3)).op == "view"


def test_nothing_is_all_alike() -> None:
    g = Graph()
    (x,) = inputs(g, (0, 3))
    assert pointwise(g, "sin", [x], "f").op == "full"
    assert number_of(reduce(g, "sum", pointwise(g, "sin", [x], "f"), [0, 1])) == 0.0
    assert number_of(reduce(g, "prod", x, [0, 1])) == 1.0
    assert cat(g, [x, x], 0).size == 0


def test_numbers_are_folded_and_gradients_that_are_zero_vanish() -> None:
    g = Graph()
    x, k = inputs(g, (3,))[0], g.input("whole", 0, (3,), "i")
    zero, one = g.full(0.0, (3,), "f"), g.full(1.0, (), "f")
    assert pointwise(g, "add", [x, zero], "f") is x
    assert pointwise(g, "mul", [x, one], "f") is x
    assert number_of(pointwise(g, "mul", [x, zero], "f")) == 0.0
    assert number_of(pointwise(g, "add", [one, one], "f")) == 2.0
    assert pointwise(g, "neg", [pointwise(g, "neg", [x], "f")], "f") is x
    for op in ("and", "or"):  # bits of integers, not truth
        assert pointwise(g, op, [k, g.full(1, (), "i")], "i").op == op
    largest = g.full(2**63 - 1, (), "i")
    assert number_of(pointwise(g, "iadd", [largest, g.full(1, (), "i")], "i")) == -(2**63)
    nan = pointwise(g, "div", [g.full(0.0, (), "f"), g.full(0.0, (), "f")], "f")
    assert number_of(nan) is None


def test_what_is_read_more_often_than_it_has_elements_is_stored() -> None:
    g = Graph()
    x, y = inputs(g, (1,), (4,))
    root = pointwise(g, "sqrt", [x], "f")
    product = pointwise(g, "mul", [expand(g, root, (4,)), y], "f")
    total = reduce(g, "sum", product, [0])
    stored = stored_nodes(reachable([total]), [total])
    assert root.number in stored and product.number not in stored


def test_long_expressions_are_cut() -> None:
    g = Graph()
    (x,) = inputs(g, (4,))
    end = x
    for _ in range(1000):
        end = pointwise(g, "sin", [end], "f")
    assert len(units(end)) >= 1000 // 64
