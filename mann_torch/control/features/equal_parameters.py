"""Networks with as many parameters as others."""

from __future__ import annotations

from ...checks import whole


def equal_parameter_hidden(n_inputs: int, n_outputs: int, n_hidden: int, n_slots: int) -> int:
    """Neurons of the plain network with as many parameters as a network with a memory.

    The memory counts n_s N numbers (paper, scenario 1). With I inputs, n outputs, N neurons and
    S slots the controller with memory has N (I + 1 + n + S) + n parameters; the plain network has
    N' (I + 1 + n) + n. The nearest whole N' is returned: 14 for the paper's arm.

    Raises `KindError`, and `ConfigError` for a size below 1 or fewer than no slots.
    """
    n_inputs, n_outputs = whole("n_inputs", n_inputs), whole("n_outputs", n_outputs)
    n_hidden, n_slots = whole("n_hidden", n_hidden), whole("n_slots", n_slots, least=0)
    per_neuron = n_inputs + 1 + n_outputs
    return round(n_hidden * (per_neuron + n_slots) / per_neuron)
