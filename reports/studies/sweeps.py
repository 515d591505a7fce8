"""One parameter of the channel, or of the message, at a time: where each method gives way."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from data_gen.channel.optics import CAPTURE_WIDTH, FILL
from data_gen.frame_pair import Cell, Source
from link.images import write_bytes
from link.layout import make_layout
from reports.engine.backends import Backend
from reports.engine.predict import OBSERVERS, Method, decode_each

PAIRS = ("canon-imac", "nikon-lg", "sony-samsung", "canon-lg", "nikon-samsung", "sony-imac")
"""Every camera and every display twice; the first three have each once."""
QUICK_PAIRS = PAIRS[:3]
VIEW, KAPPA = 45.0, 3
"""Where a sweep sets nothing else."""
LEFT_OUT = ("phi", *OBSERVERS)
"""Methods that no sweep decodes: OORC's twin, and the slow floors."""
SWEEPS_JSON = "sweeps.json"


@dataclass(frozen=True)
class Sweep:
    """A quantity and the values that it takes."""

    title: str
    axis: str
    """Label, with the unit."""
    values: tuple[float, ...]
    quick: tuple[float, ...]
    """Those of `--quick`."""
    note: str = ""
    parameter: str = ""
    """Of data_gen/parameters.py; empty for one of kappa, view and number of ratex patches."""
    fixed: tuple[tuple[str, Any], ...] = ()
    """Parameters set at every value."""
    log: bool = False
    """Logarithmic axis."""

    def setting(self, name: str, value: float, base: Source) -> tuple[Source, float, int]:
        """Source, view and kappa at one value of the sweep called ``name``."""
        source = replace(base, parameters=base.parameters + self.fixed)
        if self.parameter:
            whole = int(value) if value == int(value) else value
            source = replace(source, parameters=(*source.parameters, (self.parameter, whole)))
        if name == "ratex":
            source = replace(source, layout=make_layout(ratex=int(value)))
        return source, value if name == "angle" else VIEW, int(value) if name == "kappa" else KAPPA


SWEEPS: dict[str, Sweep] = {
    "kappa": Sweep(
        "κ, the height of a bit", "κ, gray levels", tuple(range(1, 11)), (1, 2, 3, 5, 10)
    ),
    "angle": Sweep(
        "Viewing angle", "angle, degrees", (0, 10, 20, 30, 45, 60, 70), (0, 30, 45, 60, 70),
        "The camera's exposure makes up for the fall-off of light (metering 1).",
        fixed=(("metering", 1.0),),
    ),
    "drift": Sweep(
        "Exposure drift between the frames", "drift σ, % of exposure",
        (0, 0.01, 0.03, 0.06, 0.1, 0.2), (0, 0.03, 0.1, 0.2),
        "Standard deviation of the change in log exposure.", "drift",
    ),
    "shift": Sweep(
        "Misregistration of the frames", "shift σ an axis, captured pixels",
        (0, 0.15, 0.3, 0.6, 1, 2), (0, 0.3, 1, 2),
        "Standard deviation; turning and zooming by the same order.", "jitter_px",
    ),
    "noise": Sweep(
        "Noise", "noise, × one native pixel's", (0, 0.5, 1, 2, 4, 8), (0, 1, 4),
        "1 is shot and read noise of a single native pixel of the sensor; cameras pool several.",
        "noise_scale",
    ),
    "jpeg": Sweep(
        "JPEG quality", "quality of libjpeg", (20, 35, 50, 70, 85, 95), (20, 50, 70, 95),
        "", "jpeg_quality",
    ),
    "resolution": Sweep(
        "Capture resolution", "width of the picture at 0°, captured pixels",
        (0.2, 0.25, 0.35, 0.5, 0.7, 1.0), (0.25, 0.5, 1.0),
        "The display shows 512 pixels across 8 blocks. Noise and shift shrink with the image.",
        "resolution", log=True,
    ),
    "ratex": Sweep(
        "Ratex patches", "number of patches", (1, 2, 3, 5), (1, 3, 5),
        "Methods that show no patch decode the same captures at every number.",
    ),
}  # fmt: skip
"""By name, in the report's order."""
SCALES = {"drift": 100.0, "resolution": FILL * CAPTURE_WIDTH}
"""From a sweep's value to its axis."""
NAMES = {
    "kappa": "κ {}",
    "angle": "{}°",
    "drift": "drift σ {} %",
    "shift": "shift σ {} px",
    "noise": "noise × {}",
    "jpeg": "JPEG quality {}",
    "resolution": "{} px across",
    "ratex": "{} ratex patches",
}


@dataclass(frozen=True)
class Place:
    """Predictions of one condition, with all that is needed to film it again."""

    sweep: str
    """Empty for the main comparison."""
    value: float | None
    source: Source
    predictions: list[dict[str, Any]]

    @property
    def name(self) -> str:
        """For a caption."""
        if not self.sweep or self.value is None:
            return "main comparison"
        return spoken(self.sweep, self.value)


def spoken(sweep: str, value: float) -> str:
    """A value of a sweep in words."""
    return NAMES.get(sweep, f"{sweep} {{}}").format(f"{SCALES.get(sweep, 1) * value:.4g}")


def decode_sweeps(
    base: Source,
    names: Sequence[str],
    methods: Sequence[Method],
    frames: int,
    quick: bool,
    folder: Path,
    backend: Backend,
) -> tuple[list[Place], list[str]]:
    """Decode every value of the named sweeps into ``folder``/sweeps; cut-off runs go on.

    Args:
        base: pictures, seed, and parameters that hold in every sweep.
        names: of `SWEEPS`.
        methods: those of `LEFT_OUT` are left out.
        frames: frame pairs a value and camera-display pair.
        quick: fewer values and pairs.
        folder: of the run; sweeps.json lists what was decoded.
        backend: where.

    Returns:
        the places, and a line for each cell that failed.
    """
    chosen = [method for method in methods if method.name not in LEFT_OUT]
    pairs = QUICK_PAIRS if quick else PAIRS
    places: list[Place] = []
    index: list[dict[str, Any]] = []
    failures: list[str] = []
    for name in names if chosen else ():
        sweep = SWEEPS[name]
        print(f"sweep: {sweep.title}", flush=True)
        values = sweep.quick if quick else sweep.values
        settings = [sweep.setting(name, value, base) for value in values]
        for source in dict.fromkeys(source for source, _, _ in settings):
            mine = [(v, s) for v, s in zip(values, settings, strict=True) if s[0] == source]
            cells = [Cell(pair, view, kappa) for _, (_, view, kappa) in mine for pair in pairs]
            inside = f"sweeps/{name}" if len(mine) > 1 else f"sweeps/{name}/{mine[0][0]:g}"
            lines, failed = decode_each(source, cells, frames, chosen, folder / inside, backend)
            failures += [f"{sweep.title}, {line}" for line in failed]
            for value, (_, view, kappa) in mine:
                at = {"folder": inside, "view_deg": view, "kappa": kappa}
                index.append({"sweep": name, "value": value, **at})
                places.append(Place(name, value, source, matching(lines, at)))
    listing = {
        "frames": frames,
        "pairs": list(pairs),
        "sweeps": {name: asdict(SWEEPS[name]) for name in names},
        "points": index,
    }
    write_bytes(folder / SWEEPS_JSON, (json.dumps(listing, indent=1) + "\n").encode())
    return places, failures


def matching(lines: Sequence[dict[str, Any]], at: dict[str, Any]) -> list[dict[str, Any]]:
    """The predictions at the view and kappa of ``at``."""
    return [line for line in lines if all(line[key] == at[key] for key in ("view_deg", "kappa"))]


def read_sweeps(folder: Path) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Each point that sweeps.json lists, with its predictions; nothing where there is no list."""
    file = folder / SWEEPS_JSON
    cache: dict[str, list[dict[str, Any]]] = {}
    for point in json.loads(file.read_text())["points"] if file.is_file() else ():
        inside = point["folder"]
        if inside not in cache:
            lines = (folder / inside / "predictions.jsonl").read_text().splitlines()
            cache = {inside: [json.loads(line) for line in lines]}
        yield point, matching(cache[inside], point)
