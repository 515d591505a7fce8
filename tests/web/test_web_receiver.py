"""The page's receiver puts states together, explains silence and reads films as Python's does."""

from dataclasses import asdict, astuple

import cv2
import numpy as np
import pytest
from pilot_films import filmed, texture
from streams import Stream, states_of
from web_fixtures import run_node_tests, write_fixture

from export.receive.diagnosis import Observations, explain_silence
from export.receive.receiver import Receiver
from export.receive.states import RectifiedFrame, block_purity, compose_state, points_in_view
from export.receive.timing.clock import DisplayClock
from export.receive.timing.synchronise import Toggling
from export.runtime import Decoder
from export.web.tables import layout_table
from link.code.framing import encode
from link.layout import make_layout
from link.presets import PRESETS
from models import PRETRAINED, PRETRAINED_PILOTS

OUTSIDE = np.array([[-30.0, 10.0], [600.0, -20.0], [640.0, 470.0], [20.0, 430.0]])
"""Corners of a display that lies partly outside an image of 640 x 480."""


def state_fixture(clock, numbers, seed, fps=30.0, cut=False):
    rng = np.random.default_rng(seed)
    frames = [
        RectifiedFrame(
            number / fps + 0.2,
            rng.integers(0, 256, (48, 70)).astype(np.uint8),
            points_in_view(OUTSIDE, (480, 640)) if cut and number % 3 else None,
        )
        for number in range(12)
    ]
    states = [compose_state(frames, clock, number) for number in numbers]
    return {
        "clock": np.array(astuple(clock)),
        "times": [frame.time for frame in frames],
        "images": np.array([frame.rectified for frame in frames]),
        "in_view": [frame.in_view for frame in frames],
        "numbers": list(numbers),
        "states": [
            state
            and {
                "image": state.image,
                "purity": state.purity.reshape(-1),
                "frames": state.frames,
                "blocks": [
                    {
                        "layout": layout_table(make_layout(rows, cols, 512, 384)),
                        "purity": block_purity(state.purity, make_layout(rows, cols, 512, 384)),
                    }
                    for rows, cols in ((8, 8), (24, 32), (16, 16), (12, 20))
                ],
            }
            for state in states
        ],
    }


def test_states_are_put_together_as_by_python(tmp_path):
    fixtures = [
        state_fixture(DisplayClock(0.1, 0.01, 0.0, 0.02, 0.01), range(1, 7), 1),
        state_fixture(DisplayClock(1 / 29, 0.01, 0.004, -0.02, 0.02), range(5, 18, 2), 2),
        state_fixture(DisplayClock(1 / 12, 0.03, 0.0, 0.03, 0.03), range(2, 6), 3, cut=True),
    ]
    write_fixture(tmp_path, "states", fixtures)
    run_node_tests("receiverStates", tmp_path)


def page_words(text):
    """What Python says, as the page says it, which has no flags and prints no lines."""
    return text.replace(" --", " ")


def test_silence_is_explained_in_the_words_of_python(tmp_path):
    weak = Toggling(0.9, 0.62, 15.04, 1.2)
    seen = [
        Observations(29.97, refused=2),
        Observations(30, frames=90, level=9.4),
        Observations(30, frames=90, level=240.0, clipped=0.46),
        Observations(30, frames=90, level=100.0),
        Observations(30, frames=90, found=40, seconds=1.24, level=20.3, cut=30),
        Observations(30, frames=90, found=40, level=90.0, clipped=0.4, state_hz=15.02),
        Observations(30, frames=90, found=40, level=90.0, toggling=Toggling(0, 0, 0, 0.05)),
        Observations(30, frames=90, found=40, level=90.0, toggling=Toggling(0.31, 0.2, 9.0, 0.6)),
        Observations(30, frames=90, found=40, level=90.0, toggling=weak),
        Observations(30, frames=90, found=40, level=90.0, decoded=7, progress=0.413),
        Observations(
            25, frames=90, found=40, level=90.0, decoded=7, progress=0.1, state_hz=24.2, mixed=0.8
        ),
    ]
    known = [{"seen": asdict(each), "text": page_words(explain_silence(each))} for each in seen]
    write_fixture(tmp_path, "silence", known)
    run_node_tests("receiverSilence", tmp_path)


PAPER, ROBUST = PRESETS["paper"].layout, PRESETS["robust"].layout
TEXT = b"no marks"
MODELS = {
    "paper": PRETRAINED / "decoder.onnx",
    "robust": PRETRAINED_PILOTS / "24x32.onnx",
}


def paper_film():
    """Gray frames of a hand-held display with the paper's layout, with times and true corners."""
    states = states_of(TEXT, PAPER, np.random.default_rng(5))
    return gray_frames(Stream(), states, 4)


def robust_film():
    """Gray frames of the preset robust, whose states are shown for two frames each."""
    loop = encode(TEXT, ROBUST.n_bits)
    images, corners = filmed(ROBUST, 70, seed=3, message=loop)
    return [(number / 30, *both) for number, both in enumerate(zip(images, corners, strict=True))]


def still_film():
    """One gray frame of each state, too few for a clock."""
    states = states_of(TEXT, PAPER, np.random.default_rng(5))
    still = Stream(state_hz=30.0, readout=0.0, shutter=1e-3, phase=0.1)
    return gray_frames(still, states, len(states) / 30)


def empty_film():
    """Gray frames of a room without a display."""
    wall = np.clip(90 + 30 * texture((480, 640), 4), 0, 255)
    rng = np.random.default_rng(4)
    frames = [np.clip(wall + rng.normal(0, 2, wall.shape), 0, 255) for _ in range(12)]
    return [(number / 30, frame.astype(np.uint8), None) for number, frame in enumerate(frames)]


def gray_frames(stream, states, seconds):
    return [
        (time, cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), corners)
        for time, image, corners in stream.frames(states, seconds, np.random.default_rng(6))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("film", [paper_film, robust_film, still_film, empty_film])
def test_a_film_is_read_as_by_python(film, tmp_path):
    frames = film()
    decoders = [Decoder(model, threads=1, time_limit_s=60) for model in MODELS.values()]
    receiver = Receiver(decoders, 30.0)
    events, message = [], None
    for time, image, truth in frames:
        step = receiver.push(image, time)
        message = step.message
        events.append(
            {
                "error": step.tracked and float(np.abs(step.tracked.corners - truth).mean()),
                "truth": truth,
                "scores": [pair.soft.scores for pair in step.pairs],
                "clock": receiver.state_hz,
            }
        )
        if message is not None:
            break
    else:
        message = receiver.finish().message
    assert (message is None) == (film is empty_film)
    np.array([image for _, image, _ in frames]).tofile(tmp_path / "film.gray")
    write_fixture(
        tmp_path,
        "film",
        {
            "times": [time for time, _, _ in frames],
            "shape": frames[0][1].shape,
            "decoders": [
                {"model": str(model), "layout": layout_table(decoder.layout)}
                for model, decoder in zip(MODELS.values(), decoders, strict=True)
            ],
            "message": message and message.data.decode(),
            "events": events,
            "silence": page_words(explain_silence(receiver.observations)),
        },
    )
    run_node_tests("receiver", tmp_path)
