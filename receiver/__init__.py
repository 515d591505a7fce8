"""The receiver turns camera frames into a message.

`sources` opens a folder, video or camera, `receiver` takes its frames, and `stream` says what each
of them brought. `tracking` keeps the display in sight, `timing` finds when it changes states, and
`reading` reads its bits. `diagnosis` says why no message came, and `show` draws what was decided.
"""

import os
import sys

# The receiver multiplies many small matrices. OpenBLAS would share each of them among threads,
# which then keep the processor busy with waiting for the next one, and take it from the decoder.
# numpy reads this when it is loaded: it serves the commands of this package, and no program that
# has numpy already, whose environment stays as it is.
if "numpy" not in sys.modules:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
