"""The page's JavaScript as Python's tests call it, and how its results are compared with Python's.

A test runs a function of Python and the one that was ported from it, and compares what both return:

    def test_points_are_transformed(port):
        geometry = port("link/geometry.js")
        same(geometry.transform(H, points.tolist()), transform(H, points), FLOAT64)

One process of Node.js answers the calls of all tests, so OpenCV is loaded once. Numbers, texts,
None, lists and dicts go both ways. A NumPy array becomes a typed array in row-major order, but an
image, which has two dimensions of uint8 or float32, becomes a plane. A `Layout` becomes the page's
`Layout`. From there typed arrays come back as arrays of one dimension, planes and pictures as
images, and plain objects as namespaces. Instances of classes, generators and functions stay there,
and come back as a `Remote`. Promises are waited for.
"""

import base64
import json
import subprocess
import tempfile
from collections.abc import Generator
from types import SimpleNamespace
from typing import Any

import numpy as np

from link.layout import Layout
from models import FILM_GRAPH, REGION_GRAPH
from web.host.site import WEB
from web.host.tables import layout_table

SENT_AS = {"bool": "uint8", "int64": "int32"}
"""Types of arrays that are sent as another."""
FUNCTION = object()
"""A function that is not called yet, as a member of a module or of an object."""


class PortError(Exception):
    """What JavaScript threw, with its stack."""


class Port:
    """A process of Node.js that calls the modules of web/src."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def __call__(self, module: str) -> "Remote":
        """A module, whose attributes are what it exports; its path within web/src."""
        return Remote(self, module)

    def ask(self, of: Any, name: str | None = None, **more: Any) -> Any:
        """Get a member of a module or of an object, call it (``given``) or set it (``value``)."""
        request = {"of": of, "name": name, **{key: encoded(value) for key, value in more.items()}}
        process = self._running()
        assert process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
            answer = process.stdout.readline()
        except BaseException:
            self.close()  # or the next call would take this answer for its own
            raise
        if not answer:
            self._complaints.seek(0)
            raise PortError(f"Node.js has ended: {self._complaints.read().decode()}")
        said = json.loads(answer)
        if "error" in said:
            raise PortError(f"{of if isinstance(of, str) else ''} {name}: {said['error']}")
        return self._decoded(said["result"])

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
            self._process = subprocess.Popen(
                ["node", "tests/port.js"],
                cwd=WEB,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._complaints,
            )
        return self._process

    def _decoded(self, value: Any) -> Any:
        if isinstance(value, list):
            return [self._decoded(part) for part in value]
        if not isinstance(value, dict):
            return value
        if "$array" in value:
            kind = value["$array"].replace("ClampedArray", "").removesuffix("Array").lower()
            return np.frombuffer(base64.b64decode(value["base64"]), kind)
        if "$number" in value:
            return float(value["$number"])
        if "$function" in value:
            return FUNCTION
        if "$kept" in value:
            return Remote(self, value)
        parts = {name: self._decoded(part) for name, part in value.items()}
        if parts.keys() == {"width", "height", "data"}:
            whole = parts["data"].reshape(parts["height"], parts["width"], -1)
            return whole[:, :, 0] if whole.shape[2] == 1 else whole
        return SimpleNamespace(**parts)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()


class Remote:
    """A module or an object in the process of Node.js; its members are as they are called there."""

    def __init__(self, port: Port, place: Any) -> None:
        vars(self).update(_port=port, _place=place)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # asked for by Python
            raise AttributeError(name)
        member = self._port.ask(self._place, name)
        if member is FUNCTION:
            return lambda *given: self._port.ask(self._place, name, given=given)
        return member

    def __setattr__(self, name: str, value: Any) -> None:
        self._port.ask(self._place, name, value=value)

    def __call__(self, *given: Any) -> Any:
        return self._port.ask(self._place, given=given)

    def __iter__(self) -> Generator[Any, None, Any]:
        """What a generator yields, and returns, so that `link.steps.run_to_end` takes all steps."""
        while not (step := self.next()).done:
            yield step.value
        return step.value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Remote) and self._place == other._place


def page_graphs(port: Port) -> dict[str, Any]:
    """The graphs that a receiver of the page runs, loaded."""
    film = port("export/filmGraph.js").FilmGraph(FILM_GRAPH.read_bytes())
    region = port("export/regionGraph.js").RegionGraph(REGION_GRAPH.read_bytes())
    region.warm()
    return {"film": film, "region": region}


def encoded(value: Any) -> Any:
    """Describe to web/tests/port.js what JSON has no words for."""
    if isinstance(value, SimpleNamespace):
        return encoded(vars(value))
    if isinstance(value, dict):
        return {name: encoded(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [encoded(part) for part in value]
    if isinstance(value, float) and not np.isfinite(value):
        return {"$number": str(value).replace("inf", "Infinity").replace("nan", "NaN")}
    if isinstance(value, Remote):
        return value._place
    if isinstance(value, Layout):
        return {"$layout": layout_table(value)}
    if isinstance(value, bytes):
        value = np.frombuffer(value, np.uint8)
    if isinstance(value, np.generic):
        return encoded(value.item())
    if not isinstance(value, np.ndarray):
        return value
    array = np.ascontiguousarray(value, SENT_AS.get(value.dtype.name))
    name = array.dtype.name.capitalize() + "Array"
    sent = {"$array": name, "base64": base64.b64encode(array.tobytes()).decode()}
    if value.ndim == 2 and value.dtype in (np.uint8, np.float32):
        return {"width": array.shape[1], "height": array.shape[0], "data": sent}
    return sent


def same(found: Any, expected: Any, tolerance: float = 0.0) -> None:
    """Fail unless JavaScript found the numbers that Python did, or None where Python did.

    Args:
        found: numbers in lists or arrays; an array of one dimension may stand for one of several.
        expected: numbers of some shape.
        tolerance: largest absolute difference.
    """
    __tracebackhide__ = True
    if found is None or expected is None:
        assert found is None and expected is None, f"{found}, not {expected}"
        return
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    assert found.shape in (expected.shape, (expected.size,)), f"{found.shape}, not {expected.shape}"
    found = found.reshape(expected.shape)
    differ = ~((np.abs(found - expected) <= tolerance) | (found == expected))
    differ &= ~(np.isnan(found) & np.isnan(expected))
    if differ.any():
        first = tuple(map(int, np.argwhere(differ)[0]))
        raise AssertionError(
            f"number {first} is {found[first]}, not {expected[first]}; {np.count_nonzero(differ)} "
            f"of {differ.size} differ by more than {tolerance}"
        )


def differences(found: Any, expected: Any) -> tuple[float, float]:
    """Largest and mean difference between images of one shape, in gray levels."""
    assert found.shape == expected.shape
    apart = np.abs(found.astype(np.float64) - expected)
    return float(apart.max()), float(apart.mean())
