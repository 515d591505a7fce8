"""The physical channel: display, optics and camera, and the one place that composes them."""
