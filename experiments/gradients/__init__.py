"""Gradients judged: elasticities and their pictures."""
