"""Mechanisms in motion: a drawing a kind of plant, films of them."""
