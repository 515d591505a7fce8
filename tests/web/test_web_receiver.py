"""The page's receiver puts states together, explains silence and reads films as Python's does."""

from dataclasses import asdict, dataclass

import numpy as np
import pytest
import tolerances as within
from pilot_films import TEXT, robust_film
from port import page_graphs, same

from export.film_graph import FilmGraph
from export.runtime import Decoder
from models import FILM_GRAPH, PRETRAINED_PILOTS
from receiver.diagnosis import Observations, explain_silence
from receiver.receiver import Receiver
from receiver.seen import points_in_view
from receiver.timing.synchronise import Toggling

OUTSIDE = np.array([[-30.0, 10.0], [600.0, -20.0], [640.0, 470.0], [20.0, 430.0]])
"""Corners of a display that lies partly outside an image of 640 x 480."""


def test_points_in_view(port):
    points = port("receiver/reading/film.js").pointsInView
    same(points(OUTSIDE.tolist(), 640, 480), points_in_view(OUTSIDE, (480, 640)))
    inside = [[0, 0], [99, 0], [99, 99], [0, 99]]
    assert points(inside, 100, 100) is None
    assert points(inside, 50, 100).sum() == 128


def page_words(text):
    """What Python says, as the page says it, which has no flags and prints no lines."""
    return text.replace(" --", " ")


WEAK = Toggling(0.9, 0.62, 15.04, 1.2)
FOUND = {"frames": 90, "found": 40, "level": 90.0}
SILENCES = [
    Observations(29.97, refused=2),
    Observations(30, frames=90, level=9.4),
    Observations(30, frames=90, level=240.0, clipped=0.46),
    Observations(30, frames=90, level=100.0),
    Observations(30, frames=90, found=40, seconds=1.24, level=20.3, cut=30),
    Observations(30, **FOUND, clipped=0.4, state_hz=15.02),
    Observations(30, **FOUND, toggling=Toggling(0, 0, 0, 0.05)),
    Observations(30, **FOUND, toggling=Toggling(0.31, 0.2, 9.0, 0.6)),
    Observations(30, **FOUND, toggling=WEAK),
    Observations(30, **FOUND, decoded=7, progress=0.413),
    Observations(25, **FOUND, decoded=7, progress=0.1, state_hz=24.2),
    Observations(60, **FOUND, decoded=91, state_hz=59.49, presets=["hidden"]),
    Observations(30, **FOUND, decoded=7, state_hz=29.0, presets=["hidden"]),
    Observations(29.97, frames=90, level=9.0, presets=["paper", "fast", "hidden"]),
]


@pytest.mark.parametrize("seen", SILENCES, ids=range(len(SILENCES)))
def test_silence_is_explained_in_the_words_of_python(port, seen):
    toggling = seen.toggling and {**asdict(seen.toggling), "stateHz": seen.toggling.state_hz}
    ported = {**asdict(seen), "stateHz": seen.state_hz, "toggling": toggling}
    found = port("receiver/diagnosis.js").explainSilence(ported)
    assert found == page_words(explain_silence(seen))


FRAMES_APART = 10
"""Number of frames by which the page's receiver may be later or earlier than Python's."""
BITS_ALIKE = 0.97
"""Share of bits in which a pair must be like one that Python has decoded."""
MODEL = PRETRAINED_PILOTS / "24x32.onnx"


@dataclass(frozen=True)
class Event:
    """What a frame brought: corners or None, scores of frame pairs, and states a second or None."""

    corners: object
    scores: list
    state_hz: float | None


def read(receiver, frames, rate):
    """Events until the message is whole, and the message of a receiver, Python's or the page's.

    The page's attribute for the states a second that a clock has found is named by ``rate``.
    """
    events = []
    for time, image, _ in frames:
        step = receiver.push(image, time)
        scores = [getattr(pair, "soft", pair).scores for pair in step.pairs]
        corners = step.tracked and np.array(step.tracked.corners)
        events.append(Event(corners, scores, getattr(receiver, rate)))
        if step.message is not None:
            return events, step.message
    return events, receiver.finish().message


def bits_alike(scores, others):
    """Largest share of bits that are alike in some scores and in one of several others.

    Bits that one of both erased do not count.
    """
    shared = [scores * other for other in others]
    return max((product[product != 0] > 0).mean() for product in shared if product.any())


@pytest.mark.slow
def test_a_film_is_read_as_by_python(port):
    both = enumerate(zip(*robust_film(45), strict=True))
    frames = [(number / 30, image, corners) for number, (image, corners) in both]
    decoder = Decoder(MODEL, threads=1, time_limit_s=60)
    receiver = Receiver([decoder], 30.0, FilmGraph(FILM_GRAPH, 1))
    ported = port("receiver/receiver.js").Receiver([decoder.layout], page_graphs(port), 30)
    known, message = read(receiver, frames, "state_hz")
    found, page_message = read(ported, frames, "stateHz")
    assert page_message.text == message.data.decode() == TEXT.decode()
    assert abs(len(found) - len(known)) <= FRAMES_APART
    assert any(e.corners is not None for e in found) == any(e.corners is not None for e in known)
    decoded = [scores for event in known for scores in event.scores]
    worse = []
    for number, (event, frame) in enumerate(zip(found, frames, strict=False)):
        other = known[number] if number < len(known) else Event(None, [], None)
        if event.corners is not None and other.corners is not None:
            off, known_off = (np.abs(e.corners - frame[2]).mean() for e in (event, other))
            worse.append(off - known_off)
        if event.state_hz and other.state_hz:
            assert abs(event.state_hz / other.state_hz - 1) < within.CLOCKS_APART, f"frame {number}"
        for scores in event.scores:
            assert bits_alike(scores, decoded) > BITS_ALIKE, f"frame {number}"
    assert np.median(worse) < within.CORNERS_WORSE_PX
