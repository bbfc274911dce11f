"""The road: what lies on it, how rough it is, how a wheel runs over it, and the scene that it is part of."""
