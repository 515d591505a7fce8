"""The page keeps frames, cuts windows and scores them as Python's receiver does."""

from dataclasses import astuple

import numpy as np
import pytest
from port import differences, same
from streams import seen_frame
from tolerances import FLOAT32_SUM, MOVED_SCORE_MEAN

from export.film_graph import FilmGraph
from export.parity import synthetic_window
from link.presets import PRESETS
from models import FILM_GRAPH
from receiver.reading.film import MOST_PAIRS, FilmReader
from receiver.seen import MESH, SeenFrames
from receiver.sight import StageTimes

LAYOUT = PRESETS["robust"].layout


def film_of(frames=40, seed=2, gap_s=0.0):
    """Frames as a tracker gives them, some partly outside the image, and their clock.

    After half of them none come for ``gap_s`` seconds.
    """
    rng = np.random.default_rng(seed)
    window, clock = synthetic_window(LAYOUT, rng, frames, noise=10.0)
    grays, shown = window.observation.frames, []
    for number, (gray, time) in enumerate(zip(grays, window.observation.times, strict=True)):
        image = np.repeat(np.repeat(gray.clip(0, 255).astype(np.uint8), 2, 0), 2, 1)
        in_view = None
        if number % 5 == 0:
            in_view = np.ones((MESH, MESH), bool)
            in_view[:, :3] = False
        late = gap_s if number >= frames // 2 else 0.0
        shown.append(seen_frame(float(time) + late, image, in_view, LAYOUT))
    return shown, clock


class Counting(FilmGraph):
    """The film decoder, which notes how many frame pairs each window held."""

    def decode(self, observation):
        self.counts = [*getattr(self, "counts", []), observation.mixture.count]
        return super().decode(observation)


@pytest.mark.slow
def test_windows_are_read_as_by_python(port):
    shown, clock = film_of(gap_s=20.0)
    decoder = Counting(FILM_GRAPH, 1)
    seen = SeenFrames()
    reader = FilmReader(LAYOUT, decoder, seen, 30, StageTimes())
    graph = port("export/filmGraph.js").FilmGraph(FILM_GRAPH.read_bytes())
    times = port("receiver/sight.js").StageTimes()
    ported = port("receiver/reading/film.js").FilmReader(LAYOUT, graph, 30, times)
    ported_clock = port("link/clock.js").DisplayClock(*astuple(clock))
    numbers = []
    for frame in [*shown, None]:
        now = np.inf if frame is None else frame.time
        if frame is not None:
            seen.add(frame)
            seen_by_page = {"rectified": frame.rectified, "inView": frame.in_view}
            ported.add({"time": frame.time, **seen_by_page})
        found = ported.read(ported_clock, now)
        for pair in reader.read(clock, now):
            other = found.next().value
            assert (other.number, other.frames) == (pair.number, list(pair.shown.frames))
            assert differences(other.scores, pair.soft.scores)[1] < MOVED_SCORE_MEAN
            numbers.append(pair.number)
        assert found.next().done
        seen.let_go(reader.read_until)
    assert len(numbers) >= 9
    assert numbers == sorted(set(numbers))
    assert max(decoder.counts) <= MOST_PAIRS


def test_frames_are_shrunk_as_by_python(port):
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (LAYOUT.height, LAYOUT.width)).astype(np.uint8)
    found = port("image/shrink.js").areaMeans(image, LAYOUT.width // 2, LAYOUT.height // 2)

    same(np.asarray(found), seen_frame(0.0, image).shrunk, FLOAT32_SUM)
