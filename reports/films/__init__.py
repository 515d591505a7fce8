"""Studies of films: how well a receiver reads what a simulated hand-held camera films."""
