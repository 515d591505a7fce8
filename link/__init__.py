"""The contract of the sender and the receiver; it needs numpy and OpenCV, and imports nothing else.

`layout` says where blocks and ratex patches lie, `ratex` what the patches show, `embed` and `loop`
what a display shows, `presets` which settings go together, `code` how a message becomes bits and
back. `frames`, `captures` and `geometry` define what passes from one stage to the next. `images`,
`files`, `outside`, `errors` and `cli` are how all of them read, write, raise and take flags.
"""

__version__ = "1.0.0"
