"""Continuous-time working memory with soft, hard, reallocating and relaxed attention.

This package imports nothing of control, plants or solvers: other learning code can use it alone.
"""

from ..registry import Registry
from .attention.attention import Attention
from .attention.hard import HardAttention
from .attention.reallocating import PHASES, ReallocatingAttention
from .attention.relaxed import RelaxedAttention
from .attention.relaxing import relaxed
from .attention.soft import SoftAttention
from .cells.cell import MemoryCell
from .cells.cell_state import Attended, CellState, Looked
from .cells.directions import Directions
from .cells.inertia import Inertia
from .keys import KeyRule, RepresentationKeys, StateKeys
from .sequences.layers import MemoryLayers
from .sequences.sequence import MemorySequence, Taken
from .sequences.stream import MemoryStream
from .sequences.telemetry import MemoryTrace, reallocation_log
from .working_memory import RESETS, WorkingMemory

#: Names a configuration may use. A new mechanism is one file and one line here.
ATTENTIONS: Registry[Attention] = Registry(
    "attention",
    Attention,
    {"soft": SoftAttention, "hard": HardAttention, "reallocating": ReallocatingAttention},
)
KEY_RULES: Registry[KeyRule] = Registry(
    "keys", KeyRule, {"representation": RepresentationKeys, "state": StateKeys}
)

__all__ = [
    "ATTENTIONS",
    "KEY_RULES",
    "PHASES",
    "RESETS",
    "Attended",
    "Attention",
    "CellState",
    "Directions",
    "HardAttention",
    "Inertia",
    "KeyRule",
    "Looked",
    "MemoryCell",
    "MemoryLayers",
    "MemorySequence",
    "MemoryStream",
    "MemoryTrace",
    "ReallocatingAttention",
    "RelaxedAttention",
    "RepresentationKeys",
    "SoftAttention",
    "StateKeys",
    "Taken",
    "WorkingMemory",
    "reallocation_log",
    "relaxed",
]
