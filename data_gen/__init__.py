"""The transmitter's pictures and the simulated channel; imports link only."""
