"""Find the display's clock by what toggles: measure it, fit a clock, hold it.

A clock says which state the display shows at a time, and which share of an exposure fell into it.
"""
