"""Pictures that move: what a display shows that plays films, adverts, slides or scrolling text.

Scenes are drawn over the pictures of a split (`data_gen.pictures.library`), so that no scene of the
test split shows anything of a training scene. A scene is a function of time that repeats exactly
what it gave for a time before; all about it is drawn from the generator that it was made with.

Convention: positions and speeds are shares of the picture's width, and times are seconds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.pictures.library import Picture
from link.errors import choose

Frame = NDArray[np.uint8]
"""A picture, (H, W, 3) uint8, encoded RGB."""
Scene = Callable[[float], Frame]
"""Gives the picture at a time in seconds, 0 or later."""
Draw = Callable[[Sequence[Frame], np.random.Generator], Scene]
"""Draws a scene over pictures of one size."""

PICTURE_HZ = (24.0, 25.0, 30.0, 50.0, 60.0)
"""Numbers of pictures a second of the films that are drawn."""
OPEN_SHARE, OPEN_TIMES = 0.5, 3
"""Share of the time from picture to picture for which a film camera's shutter is open, and number
of moments in it whose mean is the picture: what moves fast is blurred."""
CUT = 25.0
"""Mean change, in gray levels, within one picture's time that is a cut, which blurs nothing."""
KEPT_PICTURES = 8
"""Number of pictures that a film keeps, so that states which show the same one share it."""
LINE_TYPE = cv2.LINE_AA
"""Smooth edges of all that is drawn."""
SHIFT = 4
"""Number of binary places of coordinates that are drawn at parts of a pixel."""


@dataclass(frozen=True)
class Film:
    """A scene as a film of it: so many pictures a second, from a moment between two pictures on.

    Calling it gives the picture at a time in seconds.
    """

    name: str
    """Name of the scene, a key of `SCENES`."""
    rate: float
    """Number of pictures a second."""
    picture: Callable[[int], Frame]
    """Gives a picture by its number, 0 or more."""
    late: float
    """Share of a picture's time that has passed at time 0."""

    def __call__(self, time_s: float) -> Frame:
        """Give the picture, (H, W, 3) uint8, at a time in seconds, 0 or later."""
        return self.picture(max(0, int(np.floor(time_s * self.rate + self.late + 1e-6))))


def moving_carrier(
    scene: str, pictures: Sequence[Picture], rng: np.random.Generator, rate: float | None = None
) -> Film:
    """Draw a film of a scene.

    >>> from data_gen.pictures.library import load_pictures
    >>> film = moving_carrier("pan", load_pictures("test", 96, 64), np.random.default_rng(0))
    >>> film(0.0).shape, bool((film(0.0) == film(1.0)).all())
    ((64, 96, 3), False)

    Args:
        scene: a key of `SCENES`.
        pictures: pictures of one split and of one size, which the film has, too.
        rng: source of every random draw; all is drawn here, and nothing later.
        rate: number of pictures a second; None draws one of `PICTURE_HZ`.

    Raises:
        InputError: there is no such scene; the message lists them.
    """
    draw = choose(SCENES, scene, "scene")
    order = rng.permutation(len(pictures))
    drawn = draw([pictures[at].rgb for at in order], rng)
    hz = float(rng.choice(PICTURE_HZ)) if rate is None else rate
    late = float(rng.random())

    @lru_cache(KEPT_PICTURES)
    def picture(number: int) -> Frame:
        times = (number + OPEN_SHARE * np.arange(OPEN_TIMES) / OPEN_TIMES) / hz
        moments = [drawn(float(time)) for time in times]
        if not 0 < cv2.norm(moments[0], moments[-1], cv2.NORM_L1) < CUT * moments[0].size:
            return moments[0]
        return np.asarray(np.mean(moments, axis=0, dtype=np.float32).round(), np.uint8)

    return Film(scene, hz, picture, late)


# --- what a camera does: shots ------------------------------------------------------------------


def _seen(picture: Frame, zoom: float, right: float, down: float, turn: float = 0.0) -> Frame:
    """Show a part of a picture, which is mirrored at its borders without end.

    Args:
        picture: what is filmed.
        zoom: factor by which it is enlarged about the centre of the part.
        right: position of the part's centre from the picture's, in shares of the width.
        down: the same downwards.
        turn: angle in radians by which the camera is turned.
    """
    height, width = picture.shape[:2]
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) / zoom
    centre = np.array([width - 1, height - 1]) / 2
    start = centre + width * np.array([right, down]) - turned @ centre
    # the matrix leads from the pixels of the part to those of the picture
    matrix = np.column_stack([turned, start])
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = width, height
    return np.asarray(
        cv2.warpAffine(picture, matrix, size, flags=how, borderMode=cv2.BORDER_REFLECT)
    )


def _waves(
    rng: np.random.Generator, low_hz: float, high_hz: float, count: int = 5
) -> Callable[[float], float]:
    """Draw a smooth random function of time, of standard deviation 1."""
    speeds = 2 * np.pi * np.exp(rng.uniform(np.log(low_hz), np.log(high_hz), count))
    phases, sizes = rng.uniform(0, 2 * np.pi, count), np.sqrt(2 / count)
    return lambda time: float(sizes * np.sin(speeds * time + phases).sum())


def _from(pictures: Sequence[Frame], first: int) -> list[Frame]:
    """List pictures from one of them on, and after the last those before it."""
    return [*pictures[first:], *pictures[:first]]


def _still(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    return lambda time: pictures[0]


def _pan(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    speed, angle = np.exp(rng.uniform(np.log(0.02), np.log(0.4))), rng.uniform(0, 2 * np.pi)
    across, up, zoom = speed * np.cos(angle), 0.4 * speed * np.sin(angle), rng.uniform(1.0, 1.5)
    return lambda time: _seen(pictures[0], zoom, across * time, up * time)


def _zoom(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    swing, speed = rng.uniform(0.1, 0.5), rng.uniform(0.1, 1.2)
    phase, x, y = rng.uniform(0, 2 * np.pi), *rng.uniform(-0.15, 0.15, 2)
    return lambda time: _seen(
        pictures[0], 1.2 * np.exp(swing * (1 + np.sin(speed * time + phase))), x, y
    )


def _hand(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    size = np.exp(rng.uniform(np.log(0.002), np.log(0.015)))
    across, down, turn = (_waves(rng, 0.3, 8.0) for _ in range(3))
    along, zoom = _waves(rng, 0.05, 0.3), rng.uniform(1.05, 1.4)
    return lambda time: _seen(
        pictures[0],
        zoom,
        size * across(time) + 0.05 * along(time),
        size * down(time),
        size * turn(time),
    )


def _cuts(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Cut from shot to shot, each of another kind, and go on from the first after the last."""
    kinds = [_SHOTS[int(at)] for at in rng.integers(len(_SHOTS), size=len(pictures))]
    shots = [kind(_from(pictures, at), rng) for at, kind in enumerate(kinds)]
    ends = np.cumsum(np.exp(rng.uniform(np.log(0.5), np.log(4.0), len(shots))))
    return lambda time: shots[int(np.searchsorted(ends, time % ends[-1], "right"))](time)


# --- what moves before it -----------------------------------------------------------------------


def _laid_over(under: Frame, over: Frame, cover: NDArray[np.float32], left: int, top: int) -> Frame:
    """Lay a thing over a picture, at whole pixels; what lies outside is cut off."""
    height, width = under.shape[:2]
    tall, wide = cover.shape
    x0, x1, y0, y1 = max(left, 0), min(left + wide, width), max(top, 0), min(top + tall, height)
    shown = under.copy()
    if x0 < x1 and y0 < y1:
        thing = slice(y0 - top, y1 - top), slice(x0 - left, x1 - left)
        part, share = shown[y0:y1, x0:x1], cover[thing][:, :, None]
        part[:] = (part + share * (over[thing].astype(np.float32) - part)).round()
    return shown


def _cutout(
    picture: Frame, size: float, rng: np.random.Generator
) -> tuple[Frame, NDArray[np.float32]]:
    """Cut a thing out of a picture: a disc, a block or a figure, of a height given as a share.

    Returns:
        its levels and its cover of [0, 1].
    """
    height, width = picture.shape[:2]
    tall = max(4, round(size * height))
    wide = min(width, max(4, round(tall * rng.uniform(0.4, 1.8))))
    top, left = int(rng.integers(0, max(1, height - tall))), int(rng.integers(0, width - wide + 1))
    part = cv2.resize(picture[top : top + tall, left : left + wide], (wide, tall))
    tinted = part * rng.uniform(0.3, 1.0, 3)  # so that it stands out
    cover = np.zeros((tall, wide), np.uint8)
    middle, half = (wide // 2, tall // 2), (wide // 2 - 1, tall // 2 - 1)
    shape = rng.integers(3)
    if shape == 0:
        cv2.ellipse(cover, middle, half, 0, 0, 360, 255, -1, LINE_TYPE)
    elif shape == 1:
        cover[:] = 255
    else:
        cv2.circle(
            cover, (wide // 2, tall // 5), max(1, min(tall // 5, wide // 2)), 255, -1, LINE_TYPE
        )
        cv2.ellipse(
            cover, (wide // 2, tall), (half[0], round(0.65 * tall)), 0, 0, 360, 255, -1, LINE_TYPE
        )
    return np.asarray(tinted.round(), np.uint8), np.asarray(cover / 255, np.float32)


def _passing(
    pictures: Sequence[Frame],
    rng: np.random.Generator,
    *,
    sizes: tuple[float, float],
    speeds: tuple[float, float],
    most: int,
) -> Scene:
    """Let things pass before a picture, again and again, each from its own side."""
    under = (_still, _hand)[int(rng.integers(2))](pictures, rng)
    height, width = pictures[0].shape[:2]
    things = []
    for at in range(int(rng.integers(1, most + 1))):
        size = float(np.exp(rng.uniform(*np.log(sizes))))
        levels, cover = _cutout(pictures[(1 + at) % len(pictures)], size, rng)
        speed = float(np.exp(rng.uniform(*np.log(speeds)))) * rng.choice((-1, 1))
        things.append((levels, cover, speed, rng.random(), rng.uniform(0, 1), rng.uniform(0, 0.02)))

    def scene(time: float) -> Frame:
        shown = under(time)
        for levels, cover, speed, start, depth, bob in things:
            tall, wide = cover.shape
            reach = 1 + wide / width
            x = (start + speed * time / reach) % 1 * reach * width - wide
            y = (height - tall) * depth + bob * height * np.sin(11.0 * time)
            shown = _laid_over(shown, levels, cover, round(x), round(y))
        return shown

    return scene


def _talking(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Show a head that nods and speaks before a blurred background."""
    height, width = pictures[0].shape[:2]
    far = cv2.GaussianBlur(pictures[0], (0, 0), width / 40)
    skin = rng.uniform(70, 220) * np.array([1.0, rng.uniform(0.7, 0.85), rng.uniform(0.5, 0.75)])
    coat, hair = rng.uniform(10, 200, 3), rng.uniform(5, 120) * np.array([1.0, 0.8, 0.6])
    across, down, speech, blink = (
        _waves(rng, low, high) for low, high in ((0.1, 0.8), (0.2, 1.5), (2.0, 6.0), (0.3, 0.9))
    )
    centre, size = rng.uniform(0.35, 0.65), rng.uniform(0.18, 0.3)

    def scene(time: float) -> Frame:
        shown = np.array(far, np.uint8)
        x = width * (centre + 0.012 * across(time))
        y = height * (0.45 + 0.012 * down(time))
        unit = size * height

        def oval(right: float, low: float, a: float, b: float, colour: NDArray[np.float64]) -> None:
            at = round(2**SHIFT * (x + right * unit)), round(2**SHIFT * (y + low * unit))
            axes = (
                max(2**SHIFT, round(2**SHIFT * a * unit)),
                max(2 ** (SHIFT - 1), round(2**SHIFT * b * unit)),
            )
            tint = tuple(colour.tolist())
            cv2.ellipse(shown, at, axes, 0, 0, 360, tint, -1, LINE_TYPE, SHIFT)

        oval(0, 2.3, 1.7, 1.3, coat)
        oval(0, -0.15, 0.86, 1.08, hair)
        oval(0, 0.05, 0.75, 1.0, skin)
        lids = 0.09 if blink(time) < 1.6 else 0.01
        for side in (-0.3, 0.3):
            oval(side, -0.15, 0.13, lids, np.full(3, 240.0))
            oval(side, -0.15, 0.05, lids, np.full(3, 20.0))
        oval(0, 0.5, 0.27, 0.03 + 0.09 * max(0.0, speech(time)), np.array([90.0, 20.0, 25.0]))
        return shown

    return scene


# --- slides and text ----------------------------------------------------------------------------


def _slides(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Show one picture after another: at once, by cross-fades, or pushed in from a side."""
    stay, change = rng.uniform(0.8, 3.0), float(rng.choice((0.0, 0.4, 1.0)))
    pushed, width = rng.random() < 0.4, pictures[0].shape[1]

    def scene(time: float) -> Frame:
        number, gone = divmod(time, stay)
        now = pictures[int(number) % len(pictures)]
        share = 1 - (stay - gone) / change if change else -1.0
        if share <= 0:
            return now
        after = pictures[(int(number) + 1) % len(pictures)]
        if not pushed:
            return np.asarray(cv2.addWeighted(now, 1 - share, after, share, 0))
        edge = round(width * share)
        return np.concatenate([now[:, edge:], after[:, :edge]], axis=1)

    return scene


def _words(rng: np.random.Generator, length: int) -> str:
    """Make a line of words that mean nothing."""
    letters = rng.choice(list("etaoinshrdlucmfwypvbgk      "), length)
    return " ".join("".join(letters).split()).capitalize()


_PAPERS = (255, 255, 255), (0, 0, 0), (160, 20, 30), (20, 40, 110)


def _text_strip(width: int, tall: int, rng: np.random.Generator) -> Frame:
    """Write one line of text on a flat band of a size in pixels."""
    paper = _PAPERS[int(rng.integers(len(_PAPERS)))]
    strip = np.full((tall, width, 3), paper, np.uint8)
    ink = (255, 255, 255) if sum(paper) < 380 else (0, 0, 0)
    scale = 0.6 * tall / 21
    stroke = max(1, round(tall / 18))
    line, font = _words(rng, 5 * width // tall), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(strip, line, (0, round(0.75 * tall)), font, scale, ink, stroke, LINE_TYPE)
    return strip


def _shifted(strip: Frame, right: float, axis: int) -> Frame:
    """Move a strip, which comes round, by pixels that need not be whole."""
    whole, part = divmod(right, 1.0)
    near = np.roll(strip, -int(whole), axis)
    return np.asarray(cv2.addWeighted(near, 1 - part, np.roll(near, -1, axis), part, 0))


def _ticker(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Let a line of text run through a band below a picture that stands still or moves."""
    under = (_still, _pan, _talking)[int(rng.integers(3))](pictures, rng)
    height, width = pictures[0].shape[:2]
    tall, speed = round(height * rng.uniform(0.07, 0.14)), width * rng.uniform(0.08, 0.35)
    strip, low = _text_strip(4 * width, tall, rng), round(height * rng.uniform(0.0, 0.08))

    def scene(time: float) -> Frame:
        shown = under(time).copy()
        shown[height - low - tall : height - low] = _shifted(strip, speed * time, 1)[:, :width]
        return shown

    return scene


def _scroll(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Scroll down a page of text and pictures, steadily or by jerks."""
    height, width = pictures[0].shape[:2]
    tall = max(8, round(height / rng.uniform(14, 28)))
    dark = rng.random() < 0.4
    paper, ink = ((18,) * 3, (225,) * 3) if dark else ((255,) * 3, (25,) * 3)
    page = np.full((3 * height, width, 3), paper, np.uint8)
    for top in range(tall, 3 * height - tall, tall):
        line = _words(rng, int(rng.uniform(0.3, 1.2) * width / (0.45 * tall)))
        at = round(0.06 * width), top
        cv2.putText(page, line, at, cv2.FONT_HERSHEY_SIMPLEX, tall / 42, ink, 1, LINE_TYPE)
    for number in range(2):
        small = cv2.resize(pictures[number], None, fx=0.7, fy=0.7, interpolation=cv2.INTER_AREA)
        top = round(height * (0.4 + 1.4 * number))
        page[top : top + small.shape[0], -small.shape[1] :] = small
    speed, jerk = height * rng.uniform(0.05, 0.4), rng.integers(2) * rng.uniform(0.6, 2.0)

    def scene(time: float) -> Frame:
        if jerk > 0:  # stands still for a while, and then scrolls within a fifth of the time
            number, gone = divmod(time, jerk)
            time = jerk * (number + min(1.0, 5 * gone / jerk))
        return _shifted(page, speed * time, 0)[:height]

    return scene


# --- what is done to films ----------------------------------------------------------------------


def _letterbox(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Lay black bars above and below a film with cuts, as wide films have them."""
    film, height = _cuts(pictures, rng), pictures[0].shape[0]
    bar = round(height * rng.uniform(0.08, 0.22))

    def scene(time: float) -> Frame:
        shown = film(time).copy()
        shown[:bar] = shown[height - bar :] = 0
        return shown

    return scene


def _fades(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Fade each shot in from black and out to it."""
    stay, fade = rng.uniform(1.5, 4.0), rng.uniform(0.3, 0.8)
    shots = [_pan(_from(pictures, at), rng) for at in range(len(pictures))]

    def scene(time: float) -> Frame:
        number, gone = divmod(time, stay)
        share = min(1.0, gone / fade, (stay - gone) / fade)
        shown = shots[int(number) % len(shots)](time)
        return np.asarray(cv2.convertScaleAbs(shown, alpha=share))

    return scene


def _grain(pictures: Sequence[Frame], rng: np.random.Generator) -> Scene:
    """Add film grain, another in each of 24 pictures a second, to a shot or to cuts."""
    film = (_still, _pan, _cuts)[int(rng.integers(3))](pictures, rng)
    strength, seed = rng.uniform(2.0, 7.0), int(rng.integers(2**31))
    height, width = pictures[0].shape[:2]

    @lru_cache(2)
    def grain(number: int) -> NDArray[np.float32]:
        own = np.random.default_rng([seed, number])
        drawn = own.standard_normal((height, width), np.float32)
        soft = cv2.GaussianBlur(drawn, (0, 0), 0.7)
        return np.asarray(1.6 * strength * soft[:, :, None], np.float32)

    def scene(time: float) -> Frame:
        noisy = film(time) + grain(int(24 * time))
        return np.asarray(np.clip(noisy.round(), 0, 255), np.uint8)

    return scene


_SHOTS: tuple[Draw, ...] = (_still, _pan, _zoom, _hand, _talking)
"""Kinds of shots between which a film cuts."""
SCENES: dict[str, Draw] = {
    "pan": _pan,
    "zoom": _zoom,
    "hand": _hand,
    "cuts": _cuts,
    "passing_fast": partial(_passing, sizes=(0.1, 0.4), speeds=(0.4, 2.0), most=3),
    "passing_slow": partial(_passing, sizes=(0.1, 0.4), speeds=(0.03, 0.2), most=4),
    "passing_large": partial(_passing, sizes=(0.6, 1.0), speeds=(0.1, 0.6), most=1),
    "passing_small": partial(_passing, sizes=(0.03, 0.08), speeds=(0.05, 1.0), most=12),
    "talking": _talking,
    "slides": _slides,
    "ticker": _ticker,
    "scroll": _scroll,
    "letterbox": _letterbox,
    "fades": _fades,
    "grain": _grain,
}
"""Scenes by name: how each is drawn over pictures."""
