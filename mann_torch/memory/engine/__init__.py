"""Cells on the compiled engine."""
