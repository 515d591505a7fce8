"""Pilots: blocks that toggle with known signs, and by which a display without marks is found.

`signal` tells how surely blocks toggle as pilots do, by `waves` at the times of a film's frames.
`motion` moves the grid of a display to where its blocks toggle as expected, and `stabilise` follows
the camera. `search` looks for the display.
"""
