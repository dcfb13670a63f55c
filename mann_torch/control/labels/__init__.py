"""Where a law's measured regression comes from."""

from ...registry import Registry
from .filtered_labels import FilteredLabels
from .labels import Labels
from .measured_labels import MeasuredLabels

LABELS: Registry[Labels] = Registry(
    "label", Labels, {"filtered": FilteredLabels, "measured": MeasuredLabels}
)

__all__ = ["LABELS", "FilteredLabels", "Labels", "MeasuredLabels"]
