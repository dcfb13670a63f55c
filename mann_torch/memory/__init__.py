"""Continuous-time working memory with soft, hard, reallocating and relaxed attention.

This package imports nothing of control, plants or solvers: other learning code can use it alone.
"""

from ..registry import Registry
from .attention import Attention
from .cell import MemoryCell
from .cell_state import Attended, CellState, Looked
from .directions import Directions
from .hard import HardAttention
from .inertia import Inertia
from .keys import KeyRule, RepresentationKeys, StateKeys
from .layers import MemoryLayers
from .reallocating import PHASES, ReallocatingAttention
from .relaxed import RelaxedAttention
from .relaxing import relaxed
from .sequence import MemorySequence, Taken
from .soft import SoftAttention
from .stream import MemoryStream
from .telemetry import MemoryTrace, reallocation_log
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
