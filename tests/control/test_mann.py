"""The control and update laws against the paper's equations, written out in scalars."""

import math

import pytest
import torch

import mann_torch as mt
from mann_torch.simulation.starting import start_of
from mann_torch.types import (
    ControllerState,
    Measurement,
    MemoryState,
    NetworkState,
    ReferenceSample,
)
from tests.conftest import (
    CONTROLLERS,
    generator,
    make_controller,
    make_loop,
    make_scenario,
    randn,
)

N, n, n_in, S = 3, 2, 10, 2


def paper_controller(x, dx, s, ds, dds, W, bw, V, bv, mu, c):
    """Torque and all derivatives with hard attention, representation keys; plain Python floats."""
    e = [s[j] - x[j] for j in range(n)]
    de = [ds[j] - dx[j] for j in range(n)]
    r = [de[j] + sum(c["L"][j][k] * e[k] for k in range(n)) for j in range(n)]
    xt = e + de + list(s) + list(ds) + list(dds)
    z = [sum(V[i][k] * xt[i] for i in range(n_in)) + bv[k] for k in range(N)]
    sg = [1 / (1 + math.exp(-v)) for v in z]
    distance = [max(abs(sg[k] - mu[i][k] / c["cw"]) for k in range(N)) for i in range(S)]
    best = distance.index(min(distance))
    ho = mu[best]
    Wr = [sum(W[k][j] * r[j] for j in range(n)) for k in range(N)]
    frob = lambda A: math.sqrt(sum(v * v for row in A for v in row))  # noqa: E731
    gain = c["Kv"] + c["kv"] * (frob(W) + frob(V) + frob(mu) + c["Zm"])
    uad = [-sum(W[k][j] * (sg[k] + ho[k]) for k in range(N)) - bw[j] for j in range(n)]
    tau = [gain * r[j] - uad[j] for j in range(n)]
    ne = math.sqrt(sum(v * v for v in e))
    sp = [v * (1 - v) for v in sg]
    dW = [
        [c["Cw"] * ((sg[k] - sp[k] * z[k]) * r[j] - c["kappa"] * ne * W[k][j]) for j in range(n)]
        for k in range(N)
    ]
    dbw = [c["Cw"] * (r[j] - c["kappa"] * ne * bw[j]) for j in range(n)]
    dV = [
        [c["Cv"] * (xt[i] * Wr[k] * sp[k] - c["kappa"] * ne * V[i][k]) for k in range(N)]
        for i in range(n_in)
    ]
    dbv = [c["Cv"] * (Wr[k] * sp[k] - c["kappa"] * ne * bv[k]) for k in range(N)]
    dmu = [
        [(-mu[i][k] + c["cw"] * sg[k] + Wr[k]) * (i == best) for k in range(N)] for i in range(S)
    ]
    return tau, dW, dbw, dV, dbv, dmu


def test_torque_and_update_laws_match_the_paper_term_by_term() -> None:
    c = {"cw": 0.6, "L": [[4.0, 0.5], [0.5, 3.0]], "Kv": 11.0, "kv": 2.5, "Zm": 0.7}
    c |= {"Cw": 8.0, "Cv": 6.0, "kappa": 0.3}
    memory = mt.WorkingMemory(S, N, mt.HardAttention(), write_gain=c["cw"])
    controller = mt.MannController(
        n, N, memory, c["L"], c["Kv"], c["kv"], c["Zm"], c["Cw"], c["Cv"], c["kappa"]
    )
    x, dx, s, ds, dds = randn(5, n)
    W, bw = randn(N, n, seed=1), randn(n, seed=2)
    V, bv, mu = randn(n_in, N, seed=3), randn(N, seed=4), randn(S, N, seed=5)
    state = ControllerState(NetworkState(W, bw, V, bv), MemoryState(mu, mu[..., :0]))
    out = controller(
        ReferenceSample(s, ds, dds), Measurement(x, dx), state, memory.initial_mode(())
    )
    lists = [t.tolist() for t in (x, dx, s, ds, dds, W, bw, V, bv, mu)]
    expected = [torch.tensor(v, dtype=torch.float64) for v in paper_controller(*lists, c)]
    d = out.d_state
    ours = [out.input, *d.network, d.memory.mu]
    for mine, theirs in zip(ours, expected, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-12, atol=1e-12)


def test_plain_network_is_the_memory_controller_that_reads_nothing() -> None:
    plain = mt.MannController(n, N)
    network = plain.initial_weights((), torch.Generator().manual_seed(0))
    network = network._replace(W=randn(N, n), b_w=randn(n, seed=1))
    memory = mt.WorkingMemory(S, N, mt.HardAttention())
    empty = MemoryState(torch.zeros(S, N).double(), torch.zeros(S, 0).double())
    reference, seen = ReferenceSample(*randn(3, n)), Measurement(*randn(2, n, seed=2))
    with_memory = mt.MannController(n, N, memory)
    a = plain(reference, seen, ControllerState(network, None), None)
    b = with_memory(reference, seen, ControllerState(network, empty), memory.initial_mode(()))
    assert torch.equal(a.input, b.input)


def test_equal_parameter_count_gives_the_papers_fourteen_neurons() -> None:
    assert mt.equal_parameter_hidden(n_inputs=10, n_outputs=2, n_hidden=10, n_slots=5) == 14
    assert mt.equal_parameter_hidden(10, 2, 10, 0) == 10


@pytest.mark.parametrize("name", CONTROLLERS)
def test_input_gains_are_the_torques_derivative_where_attention_is_fixed(name: str) -> None:
    controller = make_controller(name)
    network = controller.initial_weights((), torch.Generator().manual_seed(0))
    network = network._replace(W=randn(6, 2))
    reference, q, qd = ReferenceSample(*randn(3, 2)), randn(2, seed=1), randn(2, seed=2)
    state, mode = controller.initial_state(reference, Measurement(q, qd), (), weights=network)

    def torque(velocity: torch.Tensor) -> torch.Tensor:
        return controller(reference, Measurement(q, velocity), state, mode).input

    exact = -torch.func.jacrev(torque)(qd)
    output = controller(reference, Measurement(q, qd), state, mode)
    gains = controller.input_gains(reference, output, state)
    # Soft attention's weights move with the velocity too: there the gain is approximate.
    tolerance = 0.05 if name == "soft" else 1e-10
    assert float((gains.measurement[:, 2:] - exact).norm() / exact.norm()) <= tolerance


def test_a_memory_starts_from_the_same_bits_in_any_batch() -> None:
    """Torch takes the numbers after the last whole vector another way."""
    loop = make_loop("hard", n_hidden=10)
    scenario = make_scenario()
    network = loop.controller.initial_weights((333,), generator(1))
    network = network._replace(V=30.0 * network.V)
    whole = start_of(loop, scenario, network)[0].controller.memory.mu
    for rows in (slice(0, 1), slice(1, 3), slice(0, 125), slice(300, 333)):
        part = type(network)(*(leaf[rows] for leaf in network))
        mu = start_of(loop, scenario, part)[0].controller.memory.mu
        assert torch.equal(mu, whole[rows]), rows
    for row in range(100):
        alone = type(network)(*(leaf[row] for leaf in network))
        assert torch.equal(start_of(loop, scenario, alone)[0].controller.memory.mu, whole[row])


def test_constants_by_name_with_domains_and_batch_shape() -> None:
    controller = make_controller("reallocating_initial")
    names = set(controller.constants())
    assert names == {
        "error_gain", "base_gain", "robust_gain", "weight_bound", "rate_W", "rate_V",
        "e_modification", "write_gain", "shift_threshold",
    }  # fmt: skip
    assert not any(p.requires_grad for p in controller.parameters())
    controller.tune("write_gain", "error_gain")
    free = {k for k, p in controller.constants().items() if p.requires_grad}
    assert free == {"write_gain", "error_gain"}
    controller.initialize(write_gain=[0.5, 1.0, 2.0], error_gain=[2.0, 3.0])
    assert controller.constant("write_gain").shape == (3,)
    assert controller.constant("error_gain").tolist() == [[2.0, 0.0], [0.0, 3.0]]
    with pytest.raises(mt.ConfigError, match="no design constant 'c_w'"):
        controller.tune("c_w")
    for bad in ({"write_gain": 0.0}, {"base_gain": float("nan")}, {"shift_threshold": -1.0}):
        with pytest.raises(mt.DomainError):
            controller.initialize(**bad)
    for bad_matrix in ([[1.0, 2.0], [0.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]], -1.0):
        with pytest.raises(mt.DomainError, match="positive definite"):
            controller.initialize(error_gain=bad_matrix)


def test_a_failed_initialize_changes_nothing() -> None:
    controller = make_controller("hard")
    with pytest.raises(mt.DomainError):
        controller.initialize(base_gain=99.0, write_gain=-1.0)
    assert float(controller.constant("base_gain")) == 20.0


def test_memory_of_another_size_is_refused() -> None:
    with pytest.raises(mt.ConfigError, match="N = 4"):
        mt.MannController(2, 5, mt.WorkingMemory(2, 4, mt.HardAttention()))
    with pytest.raises(mt.ConfigError, match="n_hidden = 0"):
        mt.MannController(2, 0)


def test_an_optimizer_step_keeps_lambda_symmetric_and_a_bad_one_is_named() -> None:
    controller = make_controller("nn")
    (error_gain,) = controller.tune("error_gain")
    loop = mt.ClosedLoop(mt.TwoLinkArm(), controller)
    optimizer = torch.optim.SGD([error_gain], lr=1.0)
    mt.srmse(mt.rollout(loop, make_scenario(0.1))).sum().backward()
    optimizer.step()
    assert torch.equal(error_gain, error_gain.mT) and float(error_gain[0, 1]) != 0.0
    with torch.no_grad():
        error_gain.copy_(-error_gain)
    with pytest.raises(mt.DomainError, match="error_gain"):
        mt.rollout(loop, make_scenario(0.1))


def test_saved_constants_load_with_their_batch_shape_and_are_checked() -> None:
    saved = make_controller("hard")
    saved.initialize(write_gain=[0.5, 1.0], base_gain=30.0)
    fresh = make_controller("hard")
    fresh.load_state_dict(saved.state_dict())
    assert fresh.constant("write_gain").tolist() == [0.5, 1.0]
    bad = {**saved.state_dict(), "robust.base_gain": torch.tensor(-1.0).double()}
    with pytest.raises(mt.DomainError, match="base_gain"):
        fresh.load_state_dict(bad)


def test_numbers_that_are_none_are_named() -> None:
    controller = make_controller("nn")
    with pytest.raises(mt.ConfigError, match="base_gain"):
        controller.initialize(base_gain="fast")
    with pytest.raises(mt.ConfigError, match="masses"):
        mt.arm_parameters([[0.8, 2.3], [1.0]])
