"""Studies of the simulated channel: what its effects cost, and what it predicts of the paper."""
