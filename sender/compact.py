"""Take frame pairs apart into pictures and changes, so that a page computes all states from them.

A state is a picture plus the offset of each pixel. An offset depends on four things alone: on
which frame of the pair is shown, on whether the pair's dither is turned, on the change of the
pixel's block between both frames, and on where the pixel lies among the 4 x 4 pixels over which
`link.embed.split_change` dithers. So a loop of many frame pairs over one picture is this picture, a
step of strength for each block, a short table of offsets, and a bit for each block and frame pair.
"""

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.embed import (
    BEFORE,
    THRESHOLDS,
    levels_by_step,
    levels_of_steps,
    split_change,
    with_head_room,
)
from link.layout import Layout
from link.ratex import draw_patches
from link.strength import (
    AROUND_BLOCKS,
    BLACK_LIGHT,
    EVEN,
    EVEN_LIGHT,
    LIGHT,
    LUMINANCE_FROM_RGB,
    MASKING_EXPONENT,
    MASKING_SCALE,
    MASKING_WEIGHT,
    SIGNAL_EXPONENT,
    STEPS_PER_OCTAVE,
    STILL_SENSITIVITY,
    UNCERTAINTY_BLOCKS,
)
from link.types import Image

TILE = len(THRESHOLDS)
"""Number of pixels, along either axis, after which the dither repeats."""
PACKING = 4
"""Compression level of arrays, 0 to 9; a picture of 1920 x 1080 pixels takes some 0.2 s."""
EMBEDDED_BYTES, MAX_FILM_BYTES = 2**26, 2**31
"""Size of the largest film that a page holds, and of the largest that it plays at all."""
TEMPLATE = Path(__file__).with_name("player.html")
"""Page of the player."""
PLACE = ">null<"
"""Text of the page, once, in whose place the loop goes as JSON."""


@dataclass(frozen=True)
class Compact:
    """The rule by which a page computes the states of a loop.

    Changes between the frames of a pair are numbered, and blocks of one number change alike. The
    number of a block is twice its step of strength (`link.strength`), plus its bit. Pixels of ratex
    patches have numbers of their own, which are the same in every pair.

    >>> from link.layout import make_layout
    >>> rule = Compact(make_layout(4, 4, 64, 48, modulation="antipodal", ratex=2), kappa=3)
    >>> original, embedded = rule.offsets[0]  # which are added to the picture
    >>> [int((embedded - original)[number, 0, 0, 0]) for number in (0, 1)]  # of a 0, and of a 1
    [-3, 3]
    """

    layout: Layout
    """Grid, modulation, and patches of the loop."""
    kappa: int
    """Gray levels by which blocks change."""

    @cached_property
    def changes(self) -> NDArray[np.float64]:
        """Array (C,) of the changes of blocks between the two frames, in gray levels, by number."""
        changes = np.outer(levels_by_step(self.kappa), self.layout.change_of_bits)
        return changes.reshape(-1)  # (C = 2 steps,)

    @cached_property
    def offsets(self) -> NDArray[np.intp]:
        """Array (2, 2, N, 4, 4, 3) of the levels that are added to the picture.

        The axes are: dither as it is, or turned; original or embedded frame; number of the change,
        where those of ratex patches come after the blocks' own; row and column of the pixel in its
        tile; red, green and blue.
        """
        still = np.zeros((TILE, TILE, 3), np.intp)
        patches = [(still, still + change) for change in (-self.kappa, 0, self.kappa)]
        tables = []
        for turned in (False, True):
            parts = []
            for change in self.changes:
                levels = np.full((TILE, TILE, 3), change)
                below, above = split_change(levels, BEFORE[self.layout.modulation], turned)
                parts.append((-below, above))
            tables.append(parts + patches if self.layout.ratex else parts)
        return np.array(tables, np.intp).swapaxes(1, 2)

    @cached_property
    def patches(self) -> NDArray[np.uint8]:
        """Array (height, width) of the numbers of changes in ratex patches; 0 outside them."""
        shape = self.layout.height, self.layout.width
        shown = []
        for embedded in (False, True):
            frame = np.zeros(shape, np.uint8)
            draw_patches(frame, self.layout, self.kappa, embedded=embedded)
            shown.append(frame.astype(np.intp))
        still = len(self.changes) + 1
        numbers = np.zeros(shape, np.uint8)
        for row, col in self.layout.ratex:
            top, bottom, left, right = self.layout.cell_box(row, col)
            box = slice(top, bottom), slice(left, right)
            numbers[box] = still + (shown[1][box] - shown[0][box]) // self.kappa
        return numbers

    def rooms(self, even: bool) -> NDArray[np.uint8]:
        """Make (steps, 256) gray levels to which offsets are added, by step and level of a picture.

        Args:
            even: whether blocks have steps of strength; else there is one.
        """
        ramp = np.arange(256, dtype=np.uint8)[None]
        strengths = levels_by_step(self.kappa) if even else [float(self.kappa)]
        rooms = [
            with_head_room(ramp, self.kappa, self.layout.modulation, np.full(ramp.shape, each))
            for each in strengths
        ]
        return np.concatenate(rooms)

    @property
    def known(self) -> list[str]:
        """Bits that blocks show whatever the message is, row-major: one text for each frame pair.

        A letter is "0", "1", or "." where a block carries a bit of the message. After the last text
        the first one comes again.
        """
        layout = self.layout
        letters = np.where(layout.message_mask, ".", "0").reshape(-1)
        letters[layout.pilot_blocks] = layout.pilot_bits.astype(str)
        return ["".join(letters)]

    def picture(self, picture: Image, steps: NDArray[np.uint8] | None = None) -> Image:
        """Prepare a picture, to which the offsets are added: with room for them, and with patches.

        Args:
            picture: an `Image` of the layout's size.
            steps: (rows, cols) steps of strength, None for the least.

        Returns:
            an `Image` of the same shape.
        """
        layout = self.layout
        levels = levels_of_steps(self.kappa, steps, layout)
        shown = with_head_room(picture, self.kappa, layout.modulation, levels)
        draw_patches(shown, layout, self.kappa, embedded=False)
        return shown


def film_page(rule: Compact, even: bool) -> dict[str, Any]:
    """Describe to a page, in JSON's types, how states follow from any picture of a film."""
    known = {
        "light": LIGHT.tolist(),
        "levels": EVEN_LIGHT.tolist(),
        "factors": list(EVEN.values()),
        "shares": LUMINANCE_FROM_RGB.tolist(),
        "around": AROUND_BLOCKS,
        "uncertainty": UNCERTAINTY_BLOCKS,
        "black": BLACK_LIGHT,
        "weight": MASKING_WEIGHT,
        "scale": MASKING_SCALE * STILL_SENSITIVITY,
        "exponent": MASKING_EXPONENT,
        "signal": SIGNAL_EXPONENT,
        "per_octave": STEPS_PER_OCTAVE,
    }
    rooms = base64.b64encode(rule.rooms(even).tobytes()).decode()
    return {"rooms": rooms, "even": known if even else None}


def packed(array: NDArray[np.integer]) -> str:
    """Pack whole numbers from 0 to 255 as a page reads them: what zlib makes of their differences.

    Args:
        array: any shape. Where it has three dimensions, its last axis counts the channels: each
            number is less the one before it in its channel.

    Returns:
        base64.
    """
    channels = array.shape[2] if array.ndim == 3 else 1
    numbers = np.asarray(array, np.uint8).reshape(-1)
    steps = numbers.copy()
    steps[channels:] -= numbers[:-channels]
    return base64.b64encode(zlib.compress(steps.tobytes(), PACKING)).decode()


def rule_page(rule: Compact, state_hz: float, flickers: Mapping[float, str]) -> dict[str, Any]:
    """Describe to a page, in JSON's types, how states follow from pictures and bits."""
    layout = rule.layout
    return {
        "rows": layout.rows,
        "cols": layout.cols,
        "kappa": rule.kappa,
        "state_hz": state_hz,
        "flicker": [[round(rate, 3), word] for rate, word in flickers.items()],
        "known": rule.known,
        "order": "".join("0" if sign > 0 else "1" for sign in layout.code.signs),
        "offsets": packed(128 + rule.offsets.reshape(-1, TILE * TILE, 3)),
    }
