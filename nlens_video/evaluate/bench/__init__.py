"""Accuracy against time: each preset against the sampled lens."""
