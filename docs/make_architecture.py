"""Draw docs/architecture.svg: the way of a message through the code, and who imports whom.

Run it in the checkout: python docs/make_architecture.py. The drawing has a light ground of its own,
so that it reads the same on light and dark pages, and letters that a phone still shows.
"""

from html import escape
from pathlib import Path

OUT = Path(__file__).with_name("architecture.svg")
WIDTH, MARGIN = 640, 14
BOX_WIDTH, BOX_HEIGHT, ROW_STEP = 180, 66, 104
COLUMN_STEP = (WIDTH - 2 * MARGIN - BOX_WIDTH) / 2
"""Distance of the left edges of two neighbouring boxes of the data flow, in user units."""
TOP = 58
INK, QUIET, GROUND = "#1d232b", "#4b5563", "#fdfdfb"
COLOURS = {
    "link": "#cfe3f7",
    "data_gen": "#d9ecc6",
    "models": "#fbd9c3",
    "export": "#e3d8f3",
    "reports": "#f5e7b2",
    "": "#eceef1",
}
"""Fill of each package's boxes; the empty name is what belongs to no package."""
FLOW = (
    (
        ("data", "", "message", "and a picture"),
        ("step", "link", "framing", "link/code/"),
        ("step", "link", "embed", "link/embed.py"),
    ),
    (
        ("data", "link", "Displayed", "two frames"),
        ("step", "data_gen", "channel", "or a camera"),
        ("data", "link", "Captured", "two images"),
    ),
    (
        ("step", "export", "locate, rectify", "export/locate/"),
        ("data", "link", "Rectified", "two frames"),
        ("step", "models", "decoder", "registers, decides"),
    ),
    (
        ("data", "link", "SoftBits", "a score a block"),
        ("step", "link", "framing", "link/code/"),
        ("data", "", "message", "or none"),
    ),
    (
        ("step", "reports", "metrics", "reports/score/"),
        ("step", "reports", "report", "evaluate.py"),
    ),
)
"""Rows of boxes from top to bottom: kind, package, name, and a second line."""
PACKAGES = (
    ("link", MARGIN, 0, 72, 2),
    ("models", 118, 0, 102, 1),
    ("data_gen", 118, 1, 102, 1),
    ("export", 252, 0, 82, 1),
    ("reports", 366, 0, 92, 2),
)
"""Package, left edge, first row, width and number of rows of its box."""
PACKAGE_HEIGHT, PACKAGE_STEP = 46, 62


def _box(x: float, y: float, width: float, height: float, package: str, radius: float) -> str:
    """Return a filled rectangle with rounded corners."""
    return (
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="{radius:g}" '
        f'fill="{COLOURS[package]}" stroke="{QUIET}" stroke-width="1.2"/>'
    )


def _text(x: float, y: float, words: str, size: int, colour: str = INK, weight: int = 400) -> str:
    """Return a line of text, centred at x."""
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size}" font-weight="{weight}" fill="{colour}" '
        f'text-anchor="middle">{escape(words)}</text>'
    )


def _arrow(*points: tuple[float, float]) -> str:
    """Return a line through these points with a head at its end."""
    path = " L".join(f"{x:g} {y:g}" for x, y in points)
    return (
        f'<path d="M{path}" fill="none" stroke="{INK}" stroke-width="2" marker-end="url(#head)"/>'
    )


def _flow() -> list[str]:
    """Return the boxes and arrows of the data flow."""
    parts = []
    for number, row in enumerate(FLOW):
        y = TOP + number * ROW_STEP
        for column, (kind, package, name, note) in enumerate(row):
            x = MARGIN + column * COLUMN_STEP
            centre = x + BOX_WIDTH / 2
            parts.append(_box(x, y, BOX_WIDTH, BOX_HEIGHT, package, 30 if kind == "data" else 5))
            parts.append(_text(centre, y + 29, name, 21, weight=600))
            parts.append(_text(centre, y + 52, note, 17, QUIET))
            if column + 1 < len(row):
                middle = y + BOX_HEIGHT / 2
                parts.append(_arrow((x + BOX_WIDTH, middle), (x + COLUMN_STEP - 5, middle)))
        first = MARGIN + BOX_WIDTH / 2
        below = y + BOX_HEIGHT
        if number < 3:  # from the last box of a row to the first one of the next
            last = first + 2 * COLUMN_STEP
            turn = below + (ROW_STEP - BOX_HEIGHT) / 2
            end = y + ROW_STEP - 5
            parts.append(_arrow((last, below), (last, turn), (first, turn), (first, end)))
        elif number == 3:  # scores go to the metrics, too
            parts.append(_arrow((first, below), (first, y + ROW_STEP - 5)))
    x, y = MARGIN + 2 * COLUMN_STEP, TOP + 4 * ROW_STEP
    parts.append(_box(x + 4, y + 4, 34, 24, "", 12))
    parts.append(f'<text x="{x + 48:g}" y="{y + 22}" font-size="17" fill="{INK}">data</text>')
    parts.append(_box(x + 4, y + 38, 34, 24, "", 4))
    parts.append(f'<text x="{x + 48:g}" y="{y + 56}" font-size="17" fill="{INK}">step</text>')
    return parts


def _packages(top: float) -> list[str]:
    """Return the packages and the arrows from each to what it imports."""
    parts, edges = [], {}
    for name, x, row, width, rows in PACKAGES:
        y, height = top + row * PACKAGE_STEP, PACKAGE_HEIGHT + (rows - 1) * PACKAGE_STEP
        edges[name] = (x, x + width)
        parts.append(_box(x, y, width, height, name, 5))
        parts.append(_text(x + width / 2, y + height / 2 + 7, name, 18, weight=600))
    commands = edges["reports"][1] + 34
    width = WIDTH - MARGIN - commands
    for row, name in enumerate(("train.py", "evaluate.py")):
        y = top + row * PACKAGE_STEP
        parts.append(_box(commands, y, width, PACKAGE_HEIGHT, "", 5))
        parts.append(_text(commands + width / 2, y + 30, name, 18, weight=600))
        middle = y + PACKAGE_HEIGHT / 2
        parts.append(_arrow((commands, middle), (edges["reports"][1] + 5, middle)))
    upper = top + PACKAGE_HEIGHT / 2
    lower = upper + PACKAGE_STEP
    for y, user, used in (
        (upper, "models", "link"),
        (lower, "data_gen", "link"),
        (upper, "export", "models"),
        (upper, "reports", "export"),
        (lower, "reports", "data_gen"),
    ):
        parts.append(_arrow((edges[user][0], y), (edges[used][1] + 5, y)))
    return parts


def main() -> None:
    """Write the drawing."""
    second = TOP + len(FLOW) * ROW_STEP + 24
    height = second + 16 + PACKAGE_STEP + PACKAGE_HEIGHT + 70
    heading = 'font-size="20" font-weight="700"'
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" '
        f'height="{height}" font-family="system-ui, -apple-system, \'Segoe UI\', Roboto, '
        'Helvetica, Arial, sans-serif" role="img">',
        "<title>Data flow and packages</title>",
        '<defs><marker id="head" viewBox="0 0 10 10" refX="6" refY="5" markerWidth="6" '
        f'markerHeight="6" orient="auto"><path d="M0 0 L10 5 L0 10 z" fill="{INK}"/></marker>'
        "</defs>",
        f'<rect width="{WIDTH}" height="{height}" rx="12" fill="{GROUND}"/>',
        f'<text x="{MARGIN}" y="36" {heading} fill="{INK}">The way of a message</text>',
        *_flow(),
        f'<text x="{MARGIN}" y="{second}" {heading} fill="{INK}">'
        "The packages: arrows point at what is imported</text>",
        *_packages(second + 20),
        _text(
            WIDTH / 2, height - 20, "The colour of a part above is that of its package.", 17, QUIET
        ),
        "</svg>",
    ]
    OUT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"written: {OUT}")


if __name__ == "__main__":
    main()
