"""Presets: the settings of a display that people choose from, by name.

Sender, receiver and reports take them from here, so that a name means the same to all of them.
"""

from dataclasses import dataclass
from typing import Any

from link.layout import Layout, make_layout
from link.pilot_code import PLAIN, PilotCode

USUAL_DISTANCE_M = 0.6
"""Distance of the eye from a display on a desk, in metres."""

CAMERA_FPS = (30.0, 60.0, 120.0, 240.0)
"""Numbers of frames that phones' cameras take in a second."""


def needed_camera_fps(state_hz: float) -> float:
    """Choose the slowest usual camera that takes a frame or more of each state.

    One frame is enough where the display is large in view, and two are better.

    Args:
        state_hz: number of states that the display shows in a second.

    Returns:
        one of `CAMERA_FPS`, or ``state_hz`` where all of these are slower.

    >>> needed_camera_fps(15.0), needed_camera_fps(60.0)
    (30.0, 60.0)
    """
    return next((fps for fps in CAMERA_FPS if fps >= state_hz), state_hz)


def least_camera_fps(layout: Layout, state_hz: float) -> float:
    """Give the number of frames a second that a camera needs at least for a layout.

    That is one for each state, or, where the order of the states follows a code, for each frame
    pair.

    Args:
        layout: what the display shows.
        state_hz: number of states that it shows in a second.
    """
    return state_hz if layout.code == PLAIN else state_hz / 2


@dataclass(frozen=True)
class Preset:
    """What a display shows: where bits lie, by how much blocks change, and how fast.

    >>> PRESETS["paper"].layout == make_layout()
    True
    """

    layout: Layout
    """Grid, modulation, pilots or ratex patches."""
    kappa: int
    """Number of gray levels by which blocks change."""
    state_hz: float
    """Number of states, which are original or embedded frames, that are shown in a second."""
    purpose: str = ""
    """One sentence that says what the preset is good for: in a few words, a colon, and in more."""
    distance_m: float = USUAL_DISTANCE_M
    """Distance of the eye, in metres, for which the sender says how visible the message is."""
    even: bool = False
    """Whether blocks change by what makes all of them equally visible (`link.strength`)."""

    @property
    def needs_camera_fps(self) -> float:
        """Smallest usual number of frames a second of a camera by which the preset is read."""
        return needed_camera_fps(least_camera_fps(self.layout, self.state_hz))

    def changed(self, **given: Any) -> Layout:
        """Make the layout of the preset with some of its numbers or names changed.

        What is known to the receiver follows: ratex patches take the place of pilots, and pilots
        that of patches. A preset with pilots takes `link.layout.count_pilots`'s usual number of
        them for the changed grid.

        Args:
            given: arguments of `link.layout.make_layout` by name.

        Raises:
            InputError: the changed layout is impossible.

        >>> PRESETS["hidden"].changed(rows=8, cols=8).pilots
        16
        >>> len(PRESETS["hidden"].changed(ratex=2).ratex)
        2
        """
        layout = self.layout
        usual: dict[str, Any] = {
            name: getattr(layout, name)
            for name in ("rows", "cols", "width", "height", "modulation")
        }
        if layout.pilots and not given.get("ratex"):
            usual |= {"pilots": "auto", "code": layout.code}
        return make_layout(**{**usual, **given})


PRESETS = {
    "paper": Preset(
        make_layout(),
        kappa=3,
        state_hz=15.0,
        purpose="To compare with the paper: its blocks and patches, which are seen.",
    ),
    "hidden": Preset(
        make_layout(48, 64, modulation="antipodal", pilots="auto", code=PilotCode()),
        kappa=1,
        state_hz=60.0,
        purpose="To stay unseen: below the threshold of sight 1 m from 24 inches of 200 cd/m².",
        distance_m=1.0,
        even=True,
    ),
    "fast": Preset(
        make_layout(96, 128, modulation="antipodal", pilots="auto"),
        kappa=3,
        state_hz=30.0,
        purpose="To send much: most bits a second; it flickers.",
    ),
    "robust": Preset(
        make_layout(24, 32, modulation="antipodal", pilots="auto"),
        kappa=3,
        state_hz=15.0,
        purpose="To reach every camera: far or slanted, slow or compressed; it is seen.",
    ),
}
"""Presets by name; docs/hidden.md says what each is for."""


def preset_name(layout: Layout) -> str | None:
    """Name of the preset that shows a layout, or None where none does."""
    return next((name for name, preset in PRESETS.items() if preset.layout == layout), None)


DEFAULT_PRESET = "hidden"
"""Name of the preset that is sent where no other is asked for."""
