"""The page's receiver puts states together, explains silence and reads films as Python's does."""

from dataclasses import asdict, astuple

import numpy as np
from web_fixtures import run_node_tests, write_fixture

from export.receive.diagnosis import Observations, explain_silence
from export.receive.states import RectifiedFrame, block_purity, compose_state, points_in_view
from export.receive.timing.clock import DisplayClock
from export.receive.timing.synchronise import Toggling
from export.web.tables import layout_table
from link.layout import make_layout

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
    # the page has no flags
    known = [
        {"seen": asdict(each), "text": explain_silence(each).replace(" --", " ")} for each in seen
    ]
    write_fixture(tmp_path, "silence", known)
    run_node_tests("receiverSilence", tmp_path)
