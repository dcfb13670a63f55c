"""Regimes of a plant that return: what a memory is worth there."""
