"""Benchmark problems tuned by gradient, and judged where they were not tuned."""
