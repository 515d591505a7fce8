"""Read the bits of a display that is found: put states together, score frame pairs, collect."""
