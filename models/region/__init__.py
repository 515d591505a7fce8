"""Where in a film displays toggle: a network that maps the likely places, for the search."""

CELL_PX = 8
"""Side of a cell of the map, in pixels of the frames that are mapped."""
LEAST_PX = 64
"""Smallest side, in pixels, of frames that can be mapped: one cell at the network's lowest
resolution."""
