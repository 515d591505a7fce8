"""Look for a display by its pilots.

`pilot_search` says what is done with each frame, and `window_search` in which order a window of
them is searched. `watch` holds the frames still, `proposals` says where the display may be, and
`settle` verifies it: corners move, and a test says whether it is there.
"""
