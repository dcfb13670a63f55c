"""Settings turned into loops, scenarios, weights and ensembles."""
