"""The closed loop as Warp functions: file for file the equations of the torch modules.

Each file makes the functions for one set of sizes. Warp compiles their source: what stands here is
Warp's dialect, not Python (no annotations as strings, no closures over tensors).
"""
