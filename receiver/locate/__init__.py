"""Find the lit display in a photograph.

`find.locate` reads from top to bottom: `candidates` ranks quadrilaterals that may bound a display,
which `quads` finds from lines and outlines and `edges` moves onto edges and judges; `spots` makes
quadrilaterals from ratex patches alone; and `refine` moves corners onto the patches, which
`patches` seeks and `align` follows to sub-pixels, or onto edges.
"""
