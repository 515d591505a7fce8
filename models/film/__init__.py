"""The decoder of windows of film, all frames and frame pairs together."""
