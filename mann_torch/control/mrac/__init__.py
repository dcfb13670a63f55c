"""Model-reference adaptive control."""

from .input_output_filters import InputOutputFilters
from .mrac import Mrac
from .output_mrac import OutputMrac

__all__ = ["InputOutputFilters", "Mrac", "OutputMrac"]
