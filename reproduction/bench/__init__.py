"""Measured comparisons, a module each; results go to reproduction/results/."""
