"""Watch a film from a reference frame on: what a search for a display by its pilots looks at."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from link.geometry import in_image, transform
from link.images import as_gray
from link.types import Array, Corners, Gray, Homography, Image
from receiver.pilots.compensate import Compensator
from receiver.pilots.search.film import HeldFrame, MovingOutline, Surrounded, surroundings_of
from receiver.pilots.search.stills import Stills
from receiver.pilots.stabilise import Stabiliser, Tracks, small_gray
from receiver.pilots.waves import position

WINDOW_S, LEAST_WINDOW, MOST_WINDOW = 0.4, 24, 48
"""Time, in seconds, for which a room is watched before a search ends, and the smallest and the
largest number of frames that are watched: quick cameras see more of less light. The
shortest window has six periods of a display that shows two states in four frames. Chosen by
hand."""
IN_VIEW = 0.75
"""Smallest share of the reference frame that must still be in view for a search to go on. Chosen by
hand."""
CHECKED = (np.indices((8, 8)).reshape(2, -1).T + 0.5) / 8  # (2, 8, 8) -> (64, 2)
"""Places of the reference frame, x and y in [0, 1], that are looked for in the newest one: they
tell `IN_VIEW` to 2 %."""
NEXT_FRAME = 1000
"""Units of work (`link.steps`) of a step of the search after which it needs a frame that has
yet to come: more than there is room for. Any other step is one unit, or two where it takes long."""
HELD_S, LEAST_HELD = 0.5, 35
"""Time, in seconds, and smallest number of frames for which the newest frames are kept: a display
that is found is read in them, too. They bound the memory; chosen by hand."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A place where a display may be, and the evidence that a search found there."""

    stage: str
    """Stage of the search: ``weighed`` after a rough measurement, ``verifying`` once that gave
    enough evidence, or ``verified`` where only later frames that agree, and the clock, are
    missing."""
    corners: Corners
    """The place, pixels of the reference frame; any corner may come first."""
    time: float
    """Time of the reference frame, seconds."""
    evidence: float
    """Evidence of a display there, of which its price is paid where it was verified."""


Observer = Callable[[Trial], None]
"""Takes each trial of a search when it is made."""


class Watch:
    """Holds the frames of a film still against the camera's motion since a reference frame.

    Args:
        reference: the reference frame, an `Image`.
        time: when it was taken, seconds.
        fps: nominal number of frames of the camera in a second; some may be missing.
        picture_moves: whether pictures are taken to move: the room alone is held still, and what
            has only moved is taken off the frames before pilots are sought in them.
        longer: number of times the usual number of frames that are watched.
        observer: takes what the search tells of each place that it tries, if anybody asks.
    """

    def __init__(
        self,
        reference: Image,
        time: float,
        fps: float,
        *,
        picture_moves: bool,
        longer: int = 1,
        observer: Observer | None = None,
    ) -> None:
        self._observer = observer
        self.reference, self.picture_moves = reference, picture_moves
        gray = as_gray(reference)
        self._stabiliser = Stabiliser(gray, far_apart=picture_moves)
        self.on_copy, self.on_image = self._stabiliser.on_copy, self._stabiliser.on_image
        self._compensator = Compensator(fps) if picture_moves else None
        self.first = HeldFrame(
            gray, np.eye(3), 0.0, time, changes=self._changes(self._stabiliser.reference)
        )
        """The reference as a frame."""
        usual = int(np.clip(round(WINDOW_S * fps), LEAST_WINDOW, MOST_WINDOW))
        self.window, self.soon = longer * usual, usual // 2
        """Number of frames that are watched, and number after which they are looked at first."""
        self.confirming = 2 * self.window // 3
        """Number of later frames that must agree with what is not certain."""
        self._kept: list[HeldFrame] = []  # those watched, and the newest after them
        self._held = max(LEAST_HELD, round(HELD_S * fps))
        self.stills = Stills()
        """Small copies of the frames watched, held still."""
        self.fps = fps
        self._own: dict[tuple[bytes, bool], list[Array]] = {}
        self._outlines: list[MovingOutline] = []

    @property
    def frames(self) -> list[HeldFrame]:
        """Frames watched so far; none before the second frame of the film."""
        return self._kept[: self.window]

    @property
    def later(self) -> list[HeldFrame]:
        """The newest frames after those watched, no more than `confirming`."""
        return self._kept[self.window :][-self.confirming :]

    @property
    def held(self) -> list[HeldFrame]:
        """The newest frames of all."""
        return (self._kept or [self.first])[-self._held :]

    def tell(self, stage: str, corners: Corners, evidence: float) -> None:
        """Tell the observer what was made of corners; `Trial` says what the arguments are."""
        if self._observer is not None:
            self._observer(Trial(stage, corners, self.first.time, evidence))

    def take(self, gray: Gray, time: float) -> bool:
        """Hold the next frame still, and keep it where it still shows enough of the reference.

        Args:
            gray: the frame.
            time: when it was taken, seconds.

        Returns:
            whether it does, which a frame of another size does not.
        """
        if gray.shape != self.first.gray.shape:
            return False
        copy = small_gray(gray)
        H, tracks = self._stabiliser.follow(copy), self._stabiliser.tracks
        surrounded: tuple[Surrounded, ...] | None = None
        if not self._shows_enough(H):  # a cut in the picture has taken the points along, or a pan
            tracks, surrounded = None, self._surrounded(gray, None)
            H = next((each.motion for each in surrounded), None)
        if H is None or not self._shows_enough(H):
            return False
        if surrounded is None:
            surrounded = self._surrounded(gray, tracks)
        at = position(time - self.first.time, self.fps)
        if not self._kept:  # now the film holds still
            self._keep(self.first, self._stabiliser.reference)
        frame = HeldFrame(gray, H, at, time, tracks, surrounded, self._changes(copy))
        self._keep(frame, copy)
        if len(self._kept) > self.window + max(self._held, self.confirming):
            del self._kept[self.window]
        return True

    def _keep(self, frame: HeldFrame, copy: Gray) -> None:
        """Keep a frame; while it is watched, its copy and changes are moved onto the reference."""
        self._kept.append(frame)
        if len(self._kept) <= self.window:
            H, still = frame.H_image_from_reference, self._stabiliser.still
            changes = None if frame.changes is None else still(frame.changes, H)
            self.stills.add(still(copy, H), changes)

    def _changes(self, copy: Gray) -> Gray | None:
        """Find what the copy of the next frame shows beyond what has moved, if pictures move."""
        return None if self._compensator is None else self._compensator.take(copy)

    def _shows_enough(self, H_image_from_reference: Homography | None) -> bool:
        """Tell whether a frame, held still so, shows enough of the reference."""
        if H_image_from_reference is None:
            return False
        size = np.array(self.reference.shape[1::-1])
        places = transform(H_image_from_reference, CHECKED * size - 0.5)
        return float(in_image(places, self.reference.shape).mean()) >= IN_VIEW

    def surround(self, quads: Sequence[Corners]) -> None:
        """Follow quadrilaterals by what surrounds them, too, from the reference on.

        Args:
            quads: (4, 2) pixels of the reference each.
        """
        self._outlines = [MovingOutline(self.first.gray, quad) for quad in quads]

    def moves(self, corners: Corners) -> bool:
        """Tell whether the picture that corners of the reference bound moves by itself."""
        around = surroundings_of(corners, self.held[-1].surrounded)
        return around is not None and around.outline.picture_moves

    def _surrounded(self, gray: Gray, tracks: Tracks | None) -> tuple[Surrounded, ...]:
        """Follow what surrounds quadrilaterals in the newest frame, whose points are given."""
        found = []
        for outline in self._outlines:
            shown = None if tracks is None else tracks.motion_within(outline.quad)
            corners = None if shown is None else transform(shown, outline.quad)
            found.append(outline.take(gray, corners))
        return tuple(each for each in found if each is not None)

    def places(self, corners: Corners, count: int | None = None) -> list[Array]:
        """Find where corners in the reference lie, (4, 2) pixels of the stills.

        Args:
            corners: pixels of the reference.
            count: number of frames, from the first on, in which they follow their own motion: what
                is nearer than a wall moves farther. None for one place, the room being held still;
                but where their picture moves, it may have taken the room's motion along, so that
                they follow what surrounds them in all frames.
        """
        moves = self.moves(corners)
        if count is None and not moves:
            return [self.on_copy(corners)]
        count = len(self.frames) if count is None else count
        # places that were found before the picture was seen to move are found again
        places = self._own.setdefault((corners.tobytes(), moves), [])
        for frame in self.frames[len(places) : count]:
            H_reference_from_image = np.asarray(np.linalg.inv(frame.H_image_from_reference))
            places.append(self.on_copy(transform(H_reference_from_image, frame.corners(corners))))
        return places[:count]
