"""The loop that a display shows: a message and pictures become frame pairs, one at a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import islice
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.code.framing import capacity
from link.embed import embed
from link.errors import InputError
from link.frames import Displayed
from link.layout import Layout
from link.placement import Placement, usual_size
from link.strength import block_steps

MAX_PAIRS = 4096
"""Largest number of frame pairs in a loop."""
MOST_WHOLE = 256
"""Largest number of frame pairs, some seconds of film, of what is written to hold whole loops and
whole codes."""

Pictures = Callable[[], Iterator[NDArray[np.uint8]]]
"""Pictures of any size, (H, W, 3) uint8, encoded RGB; each call begins with the first picture."""
PictureAt = Callable[[float], NDArray[np.uint8]]
"""Gives the picture that a film shows at a time in seconds, (H, W, 3) uint8, encoded RGB."""


@dataclass
class Loop:
    """Frame pairs of a loop; each shows its two frames in the order that the layout's code says.

    Message frames come in turn, and so do pictures. Every picture is shown once; then pictures
    start again until the message is whole, so that the number of pairs is a multiple of the
    message's frames: the end of the loop runs into its start as any frame into the next, and a
    receiver may join at any moment.

    >>> from link.code.framing import encode
    >>> from link.layout import make_layout
    >>> layout = make_layout(rows=5, cols=5, width=80, height=80, ratex=2)
    >>> gray = np.full((80, 80, 3), 128, np.uint8)
    >>> loop = Loop(layout, 3, encode(b"Hi", layout.n_bits), lambda: iter([gray]))
    >>> states = list(loop.states())
    >>> (len(loop.bits), len(states), states[0].shape)
    (9, 18, (80, 80, 3))
    """

    layout: Layout
    """Grid of blocks and ratex patches that the display shows."""
    kappa: int
    """Gray levels added where a bit is 1."""
    bits: NDArray[np.uint8]
    """(frames, n_bits) bits of the message, 0 or 1, as `link.code.framing.encode` returns them."""
    pictures: Pictures
    """Pictures that carry the message; each is resized for the display."""
    display_size: tuple[int, int] | None = None
    """Width and height of the display, in pixels; None for what `usual_size` chooses for the first
    picture."""
    fit: str = "cover"
    """Way in which pictures of other proportions lie on the display; a key of
    `link.placement.FITS`."""
    even: bool = False
    """Whether blocks change by what makes all of them equally visible (`link.strength`), of which
    kappa is the least."""
    moving: bool = False
    """Whether each state has a picture of its own, as films have; else each frame pair has one."""
    given: int = 0
    """Number of frame pairs, known once `carriers` was taken to its end."""
    n_pictures: int = 0
    """Number of frame pairs that show every picture once, known then as well."""

    @cached_property
    def placement(self) -> Placement:
        """Placement of the pictures on the display, which follows from the first picture.

        Raises:
            InputError: the first picture is no good, or the fit is unknown.
        """
        height, width = next(self.pictures()).shape[:2]
        size = self.display_size or usual_size((width, height), self.layout)
        return Placement(size, self.fit, (width, height))

    @cached_property
    def shown_layout(self) -> Layout:
        """The grid at the size at which it is shown, as it lies before it is turned.

        Raises:
            InputError: the first picture is no good, or too small or too large for the grid.
        """
        return self.placement.layout(self.layout)

    def carriers(self) -> Iterator["Carrier"]:
        """Give what each frame pair of one loop is made of, one after another.

        Raises:
            InputError: a picture is no good, the loop is too long, or kappa or the bits do not
                fit the layout.
        """
        last = None
        for number, (picture, after) in enumerate(self._pictures()):
            if number == MAX_PAIRS:
                raise InputError(
                    f"a loop holds at most {MAX_PAIRS} frame pairs; "
                    "give fewer pictures or a shorter video"
                )
            carrier = last = self.carrier(number, picture, last)
            if after is not picture:
                last = self.carrier(number, after, carrier)
                carrier = replace(carrier, after=last)
            yield carrier
        self.given = number + 1

    def carrier(
        self, number: int, picture: NDArray[np.uint8], before: "Carrier | None" = None
    ) -> "Carrier":
        """Say what the frame pair with a number is made of.

        Args:
            number: number of the pair, 0 or more, which chooses the bits.
            picture: picture of any size that carries them.
            before: another pair's, from which comes what is the same of the same picture.
        """
        if before is not None and before.given is picture:
            laid, steps = before.picture, before.steps
        else:
            laid = self.placement.grid_frame(picture, self.layout)
            steps = block_steps(laid, self.shown_layout) if self.even else None
        bits = self.bits[number % len(self.bits)]
        return Carrier(picture, laid, bits, steps, bool(number % 2), self)

    def states(self) -> Iterator[NDArray[np.uint8]]:
        """Give the frames of one loop as the display shows them one after another.

        Each is (height, width, 3) uint8, encoded RGB, of the display's size. The layout's code
        says whether a pair's original or its embedded frame comes first. The loop is given again
        until the code is at its end, too, so that the code goes on where the states are played
        over and over. Where that would take more than `MOST_WHOLE` pairs, the last time ends
        early: receivers lose no more by a jump in the message than by a lost frame, and the clock
        by a jump in the code.

        Raises:
            InputError: a picture is no good, the loop is too long, or kappa or the bits do not
                fit the layout.
        """
        code, number, pairs = self.layout.code, 0, None
        while number != pairs:
            for carrier in islice(self.carriers(), pairs and pairs - number):
                for frame in carrier.shown(code.sign(number)):
                    yield self.placement.display_frame(frame, self.layout)
                number += 1
            if pairs is None:
                whole = lcm(self.given, code.period)
                least = -(-self.given // code.period) * code.period
                pairs = whole if whole <= max(self.given, MOST_WHOLE) else least

    def state_of(self, pair: Displayed, number: int) -> NDArray[np.uint8]:
        """Lay the frame of a pair that the state with a number shows on the display.

        Args:
            pair: both frames of frame pair ``number`` // 2, before they are turned.
            number: number of the state, 0 or more, which with the code chooses the frame.

        Returns:
            (height, width, 3) uint8 of the display's size.
        """
        embedded = self.layout.code.states_of(number // 2)[1] == number
        frame = pair.embedded if embedded else pair.original
        return self.placement.display_frame(frame, self.layout)

    def _pictures(self) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
        """Both pictures of each pair; every picture once, then again until the message is whole."""
        given = 0
        for pair in self._of_pairs():
            given += 1
            yield pair
        self.n_pictures = given
        while True:
            for pair in self._of_pairs():
                if given % len(self.bits) == 0:
                    return
                given += 1
                yield pair

    def _of_pairs(self) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
        pictures = self.pictures()
        for picture in pictures:
            yield picture, next(pictures, picture) if self.moving else picture

    def report(self, message_bytes: int, state_hz: float) -> dict[str, Any]:
        """Say what was sent, after all `carriers` were taken: counts, seconds and bit/s.

        Args:
            message_bytes: length of the message.
            state_hz: states (original or embedded frames) shown in a second.

        Returns:
            values of JSON's types by name; seconds and bits a second as the names say.
        """
        frames, pairs = len(self.bits), self.given
        message_s = 2 * frames / state_hz
        return {
            "frames": frames,
            "pairs": pairs,
            "bits_per_frame": self.layout.n_bits,
            "message_bytes": message_bytes,
            # with the usual redundancy, of which a long message has less
            "capacity_bytes": max(message_bytes, capacity(frames, self.layout.n_bits)),
            "state_hz": round(state_hz, 3),
            "message_seconds": round(message_s, 3),
            "loop_seconds": round(2 * pairs / state_hz, 3),
            "message_bit_per_s": round(8 * message_bytes / message_s, 2),
            "bound_bit_per_s": round(self.layout.n_bits * state_hz / 2, 2),
            "kappa": self.kappa,
            "layout": self.layout.to_dict(),
            "display": {
                "width": self.placement.display_size[0],
                "height": self.placement.display_size[1],
                "fit": self.fit,
                "turned": self.placement.turns(self.layout),
            },
        }


class MovingStates:
    """States by their number, of a display that plays a film without end and a loop's message.

    >>> film = lambda time: np.full((48, 64, 3), 100 + int(10 * time), np.uint8)
    >>> bits = np.ones((2, 16), np.uint8)
    >>> loop = Loop(Layout(4, 4, 64, 48, ()), 3, bits, lambda: iter([film(0)]))
    >>> states = MovingStates(loop, film, state_hz=10.0)
    >>> int(states(4).max() - states(2).max()), int(states(5).max() - states(4).max())
    (2, 4)

    Args:
        loop: message, layout, and how pictures lie on the display.
        picture_at: the film.
        state_hz: number of states a second.
        in_step: whether both states of a frame pair show one picture; else each shows the one of
            its own time.
    """

    def __init__(
        self, loop: Loop, picture_at: PictureAt, state_hz: float, in_step: bool = False
    ) -> None:
        self._loop, self._picture_at, self._state_hz = loop, picture_at, state_hz
        self._in_step = in_step
        self._last: tuple[int, NDArray[np.uint8], Displayed] | None = None

    def __call__(self, number: int) -> NDArray[np.uint8]:
        """Give a state as it lies on the display, (height, width, 3) uint8."""
        pair = number // 2
        picture = self._picture_at((2 * pair if self._in_step else number) / self._state_hz)
        if self._last is None or self._last[0] != pair or self._last[1] is not picture:
            carrier = self._loop.carrier(pair, picture)
            self._last = pair, picture, carrier.displayed()
        return self._loop.state_of(self._last[2], number)


class LoopStates:
    """States by their number, as a display shows them that plays a loop over and over.

    The loop's frame pairs come again, and so does the layout's code, each after its own number of
    pairs; all comes again after the states that are counted here. A state is made when it is asked
    for, because those of a long loop would fill the memory.

    >>> gray = np.full((48, 64, 3), 128, np.uint8)
    >>> loop = Loop(Layout(4, 4, 64, 48, ()), 3, np.ones((2, 16), np.uint8), lambda: iter([gray]))
    >>> states = LoopStates(loop)
    >>> len(states), int(states[2].max()), int(states[3].max())
    (4, 129, 132)

    Raises:
        InputError: as `Loop.carriers` does.
    """

    def __init__(self, loop: Loop) -> None:
        carriers = list(loop.carriers())
        self._loop, self._count = loop, len(carriers)
        self._pair = lru_cache(2)(lambda k: carriers[k].displayed())

    def __len__(self) -> int:
        return 2 * lcm(self._count, self._loop.layout.code.period)

    def __getitem__(self, number: int) -> NDArray[np.uint8]:
        return self._loop.state_of(self._pair(number // 2 % self._count), number)


def loop_of_picture(
    layout: Layout, kappa: int, bits: NDArray[np.uint8], picture: NDArray[np.uint8], even: bool
) -> Loop:
    """Make a loop over one picture, for a display that has as many pixels as the layout.

    Args:
        layout: what the display shows.
        kappa: gray levels added where a bit is 1.
        bits: (frames, n_bits) bits of the message.
        picture: (H, W, 3) uint8, encoded RGB.
        even: whether all blocks change by what makes them equally visible.
    """
    size = layout.width, layout.height
    return Loop(layout, kappa, bits, lambda: iter([picture]), size, even=even)


@dataclass(frozen=True, eq=False)
class Carrier:
    """The picture, the bits and the strengths of which a frame pair is made.

    A player needs no more than picture and bits, and so spares the time for pairs.
    """

    given: NDArray[np.uint8]
    """(H, W, 3) uint8, encoded RGB, as the loop's pictures have it."""
    picture: NDArray[np.uint8]
    """(height, width, 3) uint8, encoded RGB, as it lies on the display, of the loop's shown layout.
    """
    bits: NDArray[np.uint8]
    """(n_bits,) bits, 0 or 1, that it carries."""
    steps: NDArray[np.uint8] | None
    """(rows, cols) steps of strength of the blocks; None where all change by kappa."""
    turned: bool
    """Whether the dither is turned, as in every second frame pair of a loop."""
    loop: Loop
    """The loop to which it belongs."""
    after: "Carrier | None" = None
    """This carrier over the picture of its second state, where a film shows another picture then;
    else None."""

    def shown(self, sign: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Make both states, before they are turned, in the order in which they are shown.

        Args:
            sign: 1 where the original frame comes first, -1 where it comes last.

        Raises:
            InputError: as `displayed` does.
        """
        first = self.displayed()
        second = first if self.after is None else self.after.displayed()
        if sign > 0:
            return first.original, second.embedded
        return first.embedded, second.original

    def displayed(self) -> Displayed:
        """Make both frames as the display shows them over one picture, before they are turned.

        Raises:
            InputError: kappa or the bits do not fit the layout.
        """
        loop = self.loop
        return embed(
            self.picture,
            self.bits,
            loop.shown_layout,
            loop.kappa,
            steps=self.steps,
            turned=self.turned,
        )
