"""Gaussian sums and interacting models: several hypotheses, weighted by their likelihood."""
