"""Studies of films: what receivers make of simulated hand-held video."""
