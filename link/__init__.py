"""The contract of the sender and the receiver; it needs numpy and OpenCV, and imports nothing else.

`layout` says where blocks and ratex patches lie, `ratex` what the patches show, `embed` and `loop`
what a display shows, `presets` which settings go together, `code` how a message becomes bits and
back. `frames`, `captures` and `geometry` define what passes from one stage to the next.
`visibility` computes how much of it the eye sees. `images`, `video`, `files`, `outside` and
`errors` are what all of them read, write and raise.
"""

__version__ = "0.1.0"
