"""Generated slides, maps and posters: what displays show besides photographs.

Flat areas and text are where a hidden message shows and where decoding fails, so every drawing
holds both, and every second theme is built on pure white or pure black.
What is written on them stands in texts.json.

Convention: positions are fractions of the picture's width and height, (0, 0) at the top left;
sizes of type and lines are fractions of the smaller of height and 3/4 of the width, which keeps
a 4:3, a wide and an upright picture equally legible. Colours are (R, G, B) encoded, 0 to 255.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from link.errors import choose

Colour = tuple[int, int, int]
"""Red, green and blue, encoded, 0 to 255."""
Point = tuple[float, float]
"""Position x and y as fractions of the picture's width and height."""

WHITE: Colour = (255, 255, 255)
"""White of paper and of light text."""
BLACK: Colour = (0, 0, 0)
"""Black of dark pictures and of dark text."""

_TEXTS = json.loads(Path(__file__).with_name("texts.json").read_text("utf-8"))
_SHIFT = 4  # fractional bits of the coordinates that OpenCV's drawing functions accept
_CAP_HEIGHT = 21.0  # px height of a capital in OpenCV's fonts at scale 1
_AROUND = ((-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1))


class _Canvas:
    """A picture while it is drawn; its attribute `rgb` is (H, W, 3) uint8."""

    def __init__(self, width: int, height: int, paper: Colour) -> None:
        self.rgb: NDArray[np.uint8] = np.full((height, width, 3), paper, np.uint8)
        self.width, self.height = width, height
        self.unit = min(height, 0.75 * width)
        """Number of pixels of a size of 1."""

    def _fixed(self, points: ArrayLike) -> NDArray[np.int32]:
        """Turn fractions (N, 2) into OpenCV's fixed-point pixels, whose centres are integers."""
        pixels = np.asarray(points, float) * (self.width, self.height) - 0.5
        return np.rint(pixels * (1 << _SHIFT)).astype(np.int32)

    def _thickness(self, size: float) -> int:
        return max(1, round(size * self.unit))

    def box(self, x0: float, y0: float, x1: float, y1: float, colour: Colour) -> None:
        """Fill whole pixels, so that the area inside is exactly flat."""
        columns = slice(round(x0 * self.width), round(x1 * self.width))
        self.rgb[round(y0 * self.height) : round(y1 * self.height), columns] = colour

    def polygon(self, points: ArrayLike, colour: Colour) -> None:
        cv2.fillPoly(self.rgb, [self._fixed(points)], colour, cv2.LINE_AA, _SHIFT)

    def line(self, points: ArrayLike, size: float, colour: Colour) -> None:
        thickness = self._thickness(size)
        fixed = [self._fixed(points)]
        cv2.polylines(self.rgb, fixed, False, colour, thickness, cv2.LINE_AA, _SHIFT)

    def disc(self, centre: Point, radius: float, colour: Colour) -> None:
        x, y = self._fixed([centre])[0].tolist()
        fixed_radius = round(radius * self.unit * (1 << _SHIFT))
        cv2.circle(self.rgb, (x, y), fixed_radius, colour, -1, cv2.LINE_AA, _SHIFT)

    def text(
        self,
        at: Point,
        string: str,
        size: float,
        colour: Colour,
        *,
        bold: bool = False,
        room: float = 1.0,
        align: Literal["left", "centre", "right"] = "left",
        halo: Colour | None = None,
    ) -> None:
        """Write one line on the baseline `at`, capitals `size` high, shrunk to fit `room`."""
        font = cv2.FONT_HERSHEY_DUPLEX if bold else cv2.FONT_HERSHEY_SIMPLEX
        stroke = self._thickness(0.12 * size) if bold else 1  # OpenCV 4 has stroke fonts
        scale = size * self.unit / _CAP_HEIGHT
        length = cv2.getTextSize(string, font, scale, stroke)[0][0]
        if length > room * self.width:
            scale *= room * self.width / length
            length = cv2.getTextSize(string, font, scale, stroke)[0][0]
        offset = {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * length
        x, y = round(at[0] * self.width - offset), round(at[1] * self.height)
        layers = [] if halo is None else [(dx, dy, halo) for dx, dy in _AROUND]
        for dx, dy, tint in [*layers, (0, 0, colour)]:
            at_px = (x + dx, y + dy)
            cv2.putText(self.rgb, string, at_px, font, scale, tint, stroke, cv2.LINE_AA)

    def ramp(self, y0: float, y1: float, top: Colour, bottom: Colour) -> None:
        """Fill a band with a vertical gradient."""
        rows = slice(round(y0 * self.height), round(y1 * self.height))
        t = np.linspace(0.0, 1.0, rows.stop - rows.start)[:, None, None]
        self.rgb[rows] = np.rint(np.asarray(top) * (1 - t) + np.asarray(bottom) * t)


def _pick(rng: np.random.Generator, options: Sequence[str], count: int) -> list[str]:
    """Draw `count` different options in random order."""
    return [options[int(i)] for i in rng.permutation(len(options))[:count]]


def _mix(a: Colour, b: Colour, share: float) -> Colour:
    """Return the colour a `share` of the way from a to b."""
    red, green, blue = (round(p + (q - p) * share) for p, q in zip(a, b, strict=True))
    return red, green, blue


# --- slides -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _SlideTheme:
    paper: Colour
    ink: Colour
    accents: tuple[Colour, Colour, Colour]
    header: Colour | None = None
    """Colour of a full-width title band; without one the title stands on the paper."""


_SLIDE_THEMES = (
    _SlideTheme(WHITE, (33, 37, 41), ((0, 98, 155), (242, 142, 43), (120, 144, 156))),
    _SlideTheme(BLACK, (236, 236, 236), ((255, 196, 37), (64, 176, 255), (126, 211, 33))),
    _SlideTheme(WHITE, (30, 30, 30), ((176, 32, 48), (60, 60, 60), (190, 160, 110)), (128, 20, 36)),
    _SlideTheme((18, 32, 58), (232, 238, 247), ((64, 196, 180), (255, 138, 101), (149, 165, 205))),
)


def _bar_chart(canvas: _Canvas, rng: np.random.Generator, theme: _SlideTheme) -> None:
    left, right, top, bottom = 0.54, 0.94, 0.32, 0.80
    months = _TEXTS["slides"]["months"]
    step = (right - left) / len(months)
    for i, month in enumerate(months):
        x = left + i * step
        for j, accent in enumerate(theme.accents[:2]):
            level = bottom - (bottom - top) * rng.uniform(0.25, 0.98)
            x0 = x + step * (0.10 + 0.40 * j)
            canvas.box(x0, level, x0 + 0.36 * step, bottom, accent)
        canvas.text((x + step / 2, 0.855), month, 0.022, theme.ink, align="centre", room=step)
    canvas.line([(left, bottom), (right, bottom)], 0.004, theme.ink)


def _line_chart(canvas: _Canvas, rng: np.random.Generator, theme: _SlideTheme) -> None:
    left, right, top, bottom = 0.56, 0.94, 0.32, 0.80
    for i in range(5):
        y = bottom - (bottom - top) * i / 4
        canvas.line([(left, y), (right, y)], 0.002, _mix(theme.paper, theme.ink, 0.25))
        canvas.text((left - 0.012, y + 0.01), str(20 * i), 0.020, theme.ink, align="right")
    xs = np.linspace(left, right, 12)
    for accent in theme.accents:
        walk = np.cumsum(rng.normal(0.0, 1.0, xs.size)) + 0.25 * np.arange(xs.size)
        level = 0.12 + 0.78 * (walk - walk.min()) / np.ptp(walk)
        points = np.stack([xs, bottom - (bottom - top) * level], axis=1)
        canvas.line(points, 0.009, accent)
        canvas.disc((points[-1, 0], points[-1, 1]), 0.014, accent)
    for i in range(0, xs.size, 3):
        canvas.text((xs[i], 0.855), str(2013 + i), 0.020, theme.ink, align="centre")


def _table(canvas: _Canvas, rng: np.random.Generator, theme: _SlideTheme) -> None:
    left, right, top, row = 0.50, 0.94, 0.30, 0.088
    canvas.box(left, top, right, top + row, theme.accents[0])
    minute = int(rng.integers(6 * 60, 18 * 60))
    for i, place in enumerate(["To", *_pick(rng, _TEXTS["timetables"]["places"], 5)]):
        y = top + i * row
        ink = theme.paper if i == 0 else theme.ink
        if i and i % 2 == 0:
            canvas.box(left, y, right, y + row, _mix(theme.paper, theme.ink, 0.10))
        time = f"{minute // 60:02d}:{minute % 60:02d}" if i else "Leaves"
        minute += int(rng.integers(4, 25))
        canvas.text((left + 0.02, y + 0.059), place, 0.030, ink, bold=i == 0, room=0.24)
        canvas.text((right - 0.02, y + 0.059), time, 0.030, ink, bold=i == 0, align="right")


_CHARTS = (_bar_chart, _line_chart, _table)


def _slide(rng: np.random.Generator, number: int, width: int, height: int) -> NDArray[np.uint8]:
    """Draw a slide with a title, bullets and a chart or a table."""
    theme = _SLIDE_THEMES[number % len(_SLIDE_THEMES)]
    canvas = _Canvas(width, height, theme.paper)
    chart = _CHARTS[number % len(_CHARTS)]
    texts = _TEXTS["timetables" if chart is _table else "slides"]
    title = _pick(rng, texts["titles"], 1)[0]
    if theme.header is None:
        canvas.text((0.06, 0.145), title, 0.062, theme.ink, bold=True, room=0.88)
        canvas.box(0.06, 0.19, 0.24, 0.20, theme.accents[0])
    else:
        canvas.box(0.0, 0.0, 1.0, 0.22, theme.header)
        canvas.text((0.06, 0.145), title, 0.062, WHITE, bold=True, room=0.88)
    for i, bullet in enumerate(_pick(rng, texts["bullets"], 4)):
        y = 0.375 + 0.125 * i
        canvas.disc((0.072, y - 0.016), 0.010, theme.accents[0])
        canvas.text((0.10, y), bullet, 0.033, theme.ink, room=0.37)
    chart(canvas, rng, theme)
    faint = _mix(theme.paper, theme.ink, 0.55)
    canvas.text((0.06, 0.955), "Source: own figures", 0.021, faint, room=0.4)
    canvas.text((0.94, 0.955), str(int(rng.integers(2, 40))), 0.021, faint, align="right")
    return canvas.rgb


# --- maps ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _MapTheme:
    land: Colour
    blocks: Colour
    park: Colour
    water: Colour
    street: Colour
    main_road: Colour
    ink: Colour
    panel: Colour


_MAP_THEMES = (
    _MapTheme((242, 239, 233), (226, 220, 211), (190, 224, 176), (158, 202, 232), WHITE,
              (250, 214, 120), (52, 58, 64), WHITE),
    _MapTheme((30, 34, 42), (40, 46, 56), (30, 62, 48), (16, 42, 76), (66, 74, 88),
              (176, 132, 60), (226, 230, 236), BLACK),
)  # fmt: skip


def _map(rng: np.random.Generator, number: int, width: int, height: int) -> NDArray[np.uint8]:
    """Draw a map: streets, parks, a river, main roads, labels, a title panel and a scale bar."""
    theme = _MAP_THEMES[number % len(_MAP_THEMES)]
    canvas = _Canvas(width, height, theme.land)
    angle = rng.uniform(-0.5, 0.5)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    pitch = np.array([0.105, 0.085])  # one block, in fractions of the unit
    stretch = np.array([canvas.unit / width, canvas.unit / height])

    def on_map(grid: ArrayLike) -> NDArray[np.float64]:
        """Turn block coordinates (N, 2) about the picture's centre into fractions (N, 2)."""
        at: NDArray[np.float64] = (np.asarray(grid, float) * pitch) @ turn.T * stretch + 0.5
        return at

    reach = int(np.ceil(0.75 / (pitch.min() * stretch.min())))
    cells = np.array([(x, y) for x in range(-reach, reach) for y in range(-reach, reach)])
    middles = on_map(cells + 0.5)
    cells = cells[np.all(np.abs(middles - 0.5) < 0.6, axis=1)]
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    for cell in cells[rng.random(len(cells)) < 0.75]:
        canvas.polygon(on_map(cell + 0.16 + 0.68 * square), theme.blocks)

    for i in range(-reach, reach + 1):
        canvas.line(on_map([(i, -reach), (i, reach)]), 0.009, theme.street)
        canvas.line(on_map([(-reach, i), (reach, i)]), 0.009, theme.street)

    spots = np.array([(0.20, 0.74), (0.76, 0.28), (0.80, 0.82)]) + rng.uniform(-0.05, 0.05, (3, 2))
    for spot in spots:
        corner = np.floor(np.linalg.solve(turn, (spot - 0.5) / stretch) / pitch)
        blocks = rng.integers(2, 4, 2)
        canvas.polygon(on_map(corner - blocks / 2.0 + blocks * square), theme.park)

    along = np.linspace(-0.05, 1.05, 60)
    phase, sway = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.05, 0.09)
    centre = 0.50 + rng.uniform(-0.25, 0.25) * (along - 0.5) + sway * np.sin(5.0 * along + phase)
    river = np.stack([along, centre], axis=1)
    canvas.line(river, 0.075, theme.water)

    casing = _mix(theme.main_road, BLACK, 0.35)
    west, east, north = (int(i) for i in rng.integers((-4, 2, -3), (0, 5, 0)))
    roads = [on_map([(i, -reach), (i, reach)]) for i in (west, east)]
    south = north + east - west
    roads.append(on_map([(-reach, north), (west, north), (east, south), (reach, south)]))
    for size, colour in ((0.026, casing), (0.019, theme.main_road)):
        for road in roads:
            canvas.line(road, size, colour)

    for spot, name in zip(spots, _pick(rng, _TEXTS["maps"]["parks"], 3), strict=True):
        label = _mix(theme.park, theme.ink, 0.85)
        canvas.text((spot[0], spot[1]), name, 0.026, label, align="centre", halo=theme.park)
    places = _pick(rng, _TEXTS["maps"]["districts"], 4)
    about = np.array([(0.44, 0.27), (0.62, 0.66), (0.42, 0.90), (0.86, 0.52)])
    for (x, y), name in zip(about + rng.uniform(-0.03, 0.03, (4, 2)), places, strict=True):
        canvas.text((x, y), name, 0.034, theme.ink, bold=True, align="centre", halo=theme.land)
    where = river[15]
    name = _pick(rng, _TEXTS["maps"]["rivers"], 1)[0]
    label = _mix(theme.water, theme.ink, 0.7)
    canvas.text((where[0], where[1] + 0.012), name, 0.026, label, align="centre", halo=theme.water)
    x, y = rng.uniform(0.55, 0.65), rng.uniform(0.40, 0.46)
    head = (x, y - 0.055 * stretch[1])
    pin = np.array([(0.0, 0.0), (-0.022, -0.045), (0.022, -0.045)])
    canvas.polygon(pin * stretch + (x, y), (214, 40, 40))
    canvas.disc(head, 0.028, (214, 40, 40))
    canvas.disc(head, 0.011, WHITE)

    canvas.box(0.0, 0.0, 0.34, 0.15, theme.panel)
    canvas.text((0.03, 0.075), places[0], 0.040, theme.ink, bold=True, room=0.28)
    canvas.text((0.03, 0.122), "You are here", 0.024, theme.ink, room=0.28)
    canvas.box(0.74, 0.925, 0.97, 0.985, theme.panel)
    canvas.text((0.76, 0.966), "200 m", 0.022, theme.ink, room=0.1)
    canvas.box(0.87, 0.950, 0.95, 0.960, theme.ink)
    return canvas.rgb


# --- posters ------------------------------------------------------------------------------------

_SKIES: tuple[tuple[Colour, Colour, Colour], ...] = (  # top, horizon, sun
    ((24, 36, 92), (246, 150, 110), (255, 214, 120)),
    ((8, 74, 110), (166, 220, 214), (255, 255, 255)),
    ((58, 20, 84), (240, 98, 120), (255, 182, 90)),
)
_FLATS: tuple[tuple[Colour, Colour, Colour, Colour], ...] = (  # paper, three shapes
    (WHITE, (220, 44, 36), (20, 74, 156), (248, 196, 32)),
    (BLACK, (240, 240, 240), (232, 76, 60), (26, 172, 156)),
    ((248, 206, 56), BLACK, (200, 40, 60), WHITE),
)


def _dates(rng: np.random.Generator) -> str:
    day = int(rng.integers(1, 20))
    month = _pick(rng, ("March", "May", "July", "October"), 1)[0]
    return f"{day}-{day + int(rng.integers(2, 10))} {month}"


def _landscape_poster(canvas: _Canvas, rng: np.random.Generator, words: Sequence[str]) -> None:
    """Draw a gradient sky, the sun, hills, and a black or white strip of small print."""
    top, horizon, sun = _SKIES[int(rng.integers(len(_SKIES)))]
    canvas.ramp(0.0, 0.84, top, horizon)
    canvas.disc((rng.uniform(0.60, 0.80), 0.50), 0.15, sun)
    xs = np.linspace(-0.01, 1.01, 80)
    for i, base in enumerate((0.60, 0.68, 0.76)):
        waves = rng.uniform(0.0, 2 * np.pi, 3)
        ridge = sum(0.06 / k * np.sin(3.1 * k * xs + waves[k - 1]) for k in (1, 2, 3))
        outline = [*np.stack([xs, base + 0.6 * np.asarray(ridge)], axis=1), (1.01, 1.0), (0, 1.0)]
        canvas.polygon(np.array(outline), _mix(_mix(horizon, top, 0.5), BLACK, 0.2 + 0.28 * i))
    canvas.text((0.06, 0.27), words[0], 0.190, WHITE, bold=True, room=0.88)
    canvas.text((0.065, 0.37), words[1], 0.046, WHITE, room=0.60)
    paper, ink = (WHITE, BLACK) if rng.random() < 0.5 else (BLACK, WHITE)
    canvas.box(0.0, 0.84, 1.0, 1.0, paper)
    canvas.text((0.06, 0.945), _dates(rng), 0.044, ink, bold=True, room=0.40)
    canvas.text((0.94, 0.940), "Admission free", 0.030, ink, align="right", room=0.40)


def _flat_poster(canvas: _Canvas, rng: np.random.Generator, words: Sequence[str]) -> None:
    """Draw discs, bars and triangles in flat colours, and big type."""
    paper, *shapes = _FLATS[int(rng.integers(len(_FLATS)))]
    canvas.box(0.0, 0.0, 1.0, 1.0, paper)
    ink = BLACK if sum(paper) > 380 else WHITE
    canvas.disc((rng.uniform(0.64, 0.76), rng.uniform(0.30, 0.40)), 0.27, shapes[0])
    x = rng.uniform(0.40, 0.50)
    canvas.polygon([(x, 0.66), (x + 0.30, 0.66), (x + 0.15, 0.22)], shapes[1])
    for i in range(4):
        y = 0.08 + 0.045 * i
        canvas.box(0.06, y, rng.uniform(0.24, 0.42), y + 0.022, shapes[2])
    canvas.disc((0.20, 0.46), 0.085, shapes[1])
    canvas.disc((0.20, 0.46), 0.045, paper)
    canvas.text((0.06, 0.845), words[0], 0.150, ink, bold=True, room=0.60)
    canvas.text((0.06, 0.935), words[1], 0.040, ink, room=0.50)
    canvas.text((0.94, 0.845), _dates(rng), 0.036, ink, bold=True, align="right", room=0.30)
    canvas.text((0.94, 0.935), "Town Hall", 0.036, ink, align="right", room=0.30)


def _poster(rng: np.random.Generator, number: int, width: int, height: int) -> NDArray[np.uint8]:
    """Draw big type over a landscape or over flat shapes."""
    canvas = _Canvas(width, height, WHITE)
    events = _TEXTS["posters"]["events"]
    words = events[int(rng.integers(len(events)))]
    (_landscape_poster, _flat_poster)[number % 2](canvas, rng, words)
    return canvas.rgb


_Draw = Callable[[np.random.Generator, int, int, int], NDArray[np.uint8]]
_KINDS: dict[str, _Draw] = {"slide": _slide, "map": _map, "poster": _poster}


def draw_picture(kind: str, number: int, width: int, height: int) -> NDArray[np.uint8]:
    """Draw picture `number` of a kind; with one version of OpenCV every call gives the same bytes.

    >>> draw_picture("map", 0, width=128, height=96).shape
    (96, 128, 3)

    Args:
        kind: "slide", "map" or "poster".
        number: number, at least 0, which seeds all that is random and takes the themes in turn.
        width: width of the picture, pixels.
        height: height of the picture, pixels.

    Returns:
        The picture, (height, width, 3) uint8, RGB encoded.

    Raises:
        InputError: an unknown kind.
    """
    drawing = choose(_KINDS, kind, "kind of drawing")
    rng = np.random.default_rng([list(_KINDS).index(kind), number])
    return drawing(rng, number, width, height)
