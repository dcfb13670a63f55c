"""Hydra configuration files. This file makes them importable once installed."""
