"""A deployed step for runtimes that people have: torch.export, AOTInductor, ONNX."""

from .aoti import AotiTick, to_aoti
from .exported import ExportedTick, exported, to_torch_export
from .onnx_file import OnnxTick, to_onnx

__all__ = [
    "AotiTick",
    "ExportedTick",
    "OnnxTick",
    "exported",
    "to_aoti",
    "to_onnx",
    "to_torch_export",
]
