"""A detector compiled for the device: from its one-sweep program to a file that runs there without JAX."""
