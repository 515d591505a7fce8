"""Verify a proposal: move its corners to where the pilots fit the grid, and test for a display.

A *proposal* is a quadrilateral that may be a display. Its *evidence* is the natural logarithm of
the probability that chance brings as much, which is a false alarm, with the sign turned. A display
is detected where evidence reaches the detection threshold `SURE`. Unless it is far above, later
frames, to which the corners were not fitted, must agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from link.layout import Layout
from link.pilots import expected_changes
from link.steps import Steps
from link.types import Array
from receiver.pilots.motion import moved_corners
from receiver.pilots.search.all_blocks import BlockFit, block_fit, block_maps
from receiver.pilots.search.film import HeldFrame, positions, rectified_views
from receiver.pilots.search.parts import COARSE_SIZE, MANY, coarse_shift
from receiver.pilots.search.proposals import Proposal, weigh
from receiver.pilots.search.watch import NEXT_FRAME, Watch
from receiver.pilots.toggling import over_deviation

SURE, SURE_SHARE = 16.0, 0.5
"""Detection threshold: the smallest evidence, after paying for everything that was tried, at which
a display is detected. Evidence is the natural logarithm of the false-alarm probability with the
sign turned, so 16 allows one false alarm in some ten million searches. Few pilots cannot bring so
much; for them it is this share of their number."""
TRIALS = 1000
"""Number of quadrilaterals, turns, layouts and rounds that a search may try: evidence pays its
natural logarithm, since the false-alarm probability of the search is at most so many times that of
a trial (Bonferroni). Chosen by hand."""
PRICE = float(np.log(TRIALS))
"""Evidence that a proposal pays for all the trials of its search."""
CERTAIN, CERTAIN_SHARE = 35.0, 0.75
"""Evidence with which a display is believed at once. It is enough to have `CERTAIN_SHARE` times the
number of pilots where that is less. With less evidence, later frames must agree. Corners that were
fitted to the same frames bring evidence of their own, which `TRIALS` does not allow for; `CERTAIN`,
more than twice `SURE`, was chosen by hand to outweigh it."""
CONFIRMED = 9.0
"""Evidence that later frames must bring where they have to agree. The place was chosen before they
came, so no trials are taken off: the false-alarm probability is one in 8,000."""
LOOKS, EARLY = (0.5, 0.75, 1.0), 2.0
"""Shares of the later frames after which it is seen whether they agree, and the evidence that must
come on top before the last of them, because chance gets a try with each. Chosen by hand; the price
of three tries is at most the logarithm of 3, which is 1.1."""
NEARLY = 0.5
"""Share of the evidence needed from which on later frames are waited for, to be weighed too:
evidence grows with the number of frames, and some two thirds as many come (`Watch.confirming`)."""
HINT = 6.0
"""Evidence of a proposal, before it pays, at which its corners are refined once all frames were
seen: a false-alarm probability of one in 400, so that few proposals of chance cost the time."""
COARSE_ROUNDS, BLOCK_ROUNDS, LENS_ROUNDS = 5, 5, 20
"""Largest number of times that corners are moved by parts of the display, by all of its blocks, and
by these while the lens is found, too. They bound the work; chosen by hand."""
ROUNDS_AT_ONCE = 3
"""Number of moves by all blocks that are made in one step, which then takes about as long as other
steps of the search. Chosen by hand."""
SETTLED_PX = 3.0
"""Distance, in layout pixels, below which a coarse move is the last one: less than half a block of
8 px, from where the fit by all blocks goes on. Chosen by hand."""


@dataclass(frozen=True, eq=False)
class Detection:
    """A display that was detected."""

    proposal: Proposal
    """Corners of the display in the reference frame, its layout, and how it toggles."""
    k: float
    """Coefficient of the lens (`link.geometry.Lens`); 0 where nothing speaks for another."""


def verify(
    proposal: Proposal,
    evidence: float,
    watch: Watch,
) -> Steps[Detection | None]:
    """Move corners to where the pilots fit the grid, step by step, and weigh what they bound.

    A move by the pilots is kept only if they then toggle more surely: in a dark picture, parts may
    have been matched amiss. What all blocks say of the corners is kept where the display is
    detected there, too.

    Args:
        proposal: where a display may be.
        evidence: evidence of the proposal in all frames so far, before it pays for anything.
        watch: the film, of which there may be more after each step.

    Returns:
        the display, or None where none is detected.
    """
    layout, frames = proposal.layout, list(watch.frames)
    enough = NEARLY * _needed(layout)
    start, evidence = yield from _shifted(proposal, evidence, frames, watch.fps)
    if evidence < HINT:
        return None
    used = len(watch.frames)
    fit = yield from _by_blocks(start, watch.frames[:used])
    yield 1
    fitted = start if fit is None else _moved(start, fit)
    known: dict[HeldFrame, NDArray[np.float32]] = {}
    by_blocks, toggling = weigh(fitted, frames, watch.fps, known)
    yield 1
    evidence, by_blocks = max(evidence, by_blocks) - PRICE, by_blocks - PRICE
    if evidence < enough:
        return None
    if by_blocks >= enough:
        best = replace(fitted, toggling=toggling)
    else:
        best, known, fit = replace(start, toggling=toggling), {}, None
    watch.tell("verified", best.corners, evidence)
    if evidence < min(CERTAIN, CERTAIN_SHARE * layout.pilots):
        confirmed = yield from _confirmed(best, evidence, frames, used, watch, known)
        if confirmed is None:
            return None
        best = confirmed
    k = 0.0 if fit is None else (yield from _through_lens(fit, start, frames[0]))
    if fit is not None and k:
        best, known = replace(_moved(start, fit), toggling=best.toggling), {}
    while not best.toggling.clear and len(watch.later) < watch.confirming:
        yield NEXT_FRAME  # each frame that comes tells more of the clock
        _, toggling = weigh(best, [*watch.frames, *watch.later], watch.fps, known)
        best = replace(best, toggling=toggling)
    return Detection(best, k)


def _needed(layout: Layout) -> float:
    """Give the detection threshold for a layout, which may have few pilots."""
    return min(SURE, SURE_SHARE * layout.pilots)


def _shifted(
    proposal: Proposal, evidence: float, frames: Sequence[HeldFrame], fps: float
) -> Steps[tuple[Proposal, float]]:
    """Move a proposal by parts of the display, if that brings evidence; it, and its evidence."""
    moved = replace(proposal, corners=(yield from _by_parts(proposal, frames)))
    now, _ = weigh(moved, frames, fps)
    yield 1
    return (moved, now) if now > evidence else (proposal, evidence)


def _confirmed(
    proposal: Proposal,
    evidence: float,
    frames: Sequence[HeldFrame],
    used: int,
    watch: Watch,
    known: dict[HeldFrame, NDArray[np.float32]],
) -> Steps[Proposal | None]:
    """Wait until later frames, to which the corners were not fitted, confirm a proposal.

    Args:
        proposal: where a display may be, and how it toggles.
        evidence: evidence of the proposal in ``frames``, of which its price is paid.
        frames: frames by which the proposal was weighed.
        used: number of the watch's frames to which the corners were fitted.
        watch: the film, of which there may be more after each step.
        known: values of the proposal's pilots in frames, as `weigh` takes them.

    Returns:
        the proposal, with how it toggles in all frames where these were needed; or None where the
        later frames do not confirm it.
    """
    needed = _needed(proposal.layout)
    for look in LOOKS:
        while len(later := [*watch.frames[used:], *watch.later]) < look * watch.confirming:
            yield NEXT_FRAME
        agreed = weigh(proposal, later, watch.fps, known)
        if agreed[0] < CONFIRMED + EARLY * (look < 1):
            continue
        if evidence < needed:  # all frames say more, unless some were worse than later ones
            yield 1
            together = weigh(proposal, [*frames, *later], watch.fps, known)
            now, toggling = max(agreed, together, key=lambda weighed: weighed[0])
            evidence = max(evidence, now - PRICE - float(np.log(2)))
            proposal = replace(proposal, toggling=toggling)
            yield 1
        if evidence >= needed:
            return proposal
    return None


def _by_parts(proposal: Proposal, frames: Sequence[HeldFrame]) -> Steps[Array]:
    """Move corners, (4, 2) pixels of the reference frame, by parts of the display."""
    layout, corners = proposal.layout, proposal.corners
    for _ in range(COARSE_ROUNDS):
        views = rectified_views(corners, layout, frames, COARSE_SIZE)
        if views is None:
            break
        line = proposal.toggling.amplitudes(over_deviation(views), positions(frames))
        fit = coarse_shift(line, expected_changes(layout), layout)
        yield 1
        if fit is None:
            break
        moved = moved_corners(corners, fit[0], layout)
        far = float(np.linalg.norm(moved - corners, axis=1).max())
        corners = moved
        if fit[1] >= MANY and far < SETTLED_PX:
            break
    return corners


def _by_blocks(proposal: Proposal, frames: Sequence[HeldFrame]) -> Steps[BlockFit | None]:
    """Move corners by all blocks at once, to parts of a pixel; None where they are not sound."""
    maps = block_maps(proposal.layout)
    views = []
    for frame in frames:
        view = frame.block_view(proposal.corners, maps)
        if view is None:
            return None
        views.append(view)
    yield 1
    fit = yield from block_fit(maps, views, positions(frames), proposal.toggling)
    for number in range(BLOCK_ROUNDS):
        if number % ROUNDS_AT_ONCE == 0:
            yield 1
        if fit.step():
            break
    return fit


def _through_lens(fit: BlockFit, start: Proposal, reference: HeldFrame) -> Steps[float]:
    """Go on with a fit by all blocks, and find how the lens bends the display.

    Args:
        fit: a fit that began with the corners of ``start``.
        start: proposal whose corners the fit moves.
        reference: the reference frame.

    Returns:
        the coefficient of the lens; 0 where the lens bends the display by too little to tell.
    """
    height, width = reference.gray.shape
    fit.free_lens(start.corners, (width, height))
    for _ in range(LENS_ROUNDS):
        ended = fit.step()
        if not fit.bends():
            return 0.0
        if ended:
            break
        yield 1
    return fit.k


def _moved(proposal: Proposal, fit: BlockFit) -> Proposal:
    """Move the corners of a proposal to where a fit by all blocks puts them."""
    corners = moved_corners(proposal.corners, fit.shift(), proposal.layout)
    return replace(proposal, corners=corners)
