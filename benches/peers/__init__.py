"""What others would write for the same pipeline: each module's `candidates(batch)`, by name and estimator."""
