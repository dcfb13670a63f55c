"""Sweeps that add up: one table and one picture of many runs."""
