"""Vectorised, differentiable signal processing for the range sensors of cars, in JAX."""
