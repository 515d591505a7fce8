"""Events: what the receiver says, as `receiver` prints it, one JSON object each.

`web.package.schema` makes the JSON Schema and the page's types of them, descriptions included.
Other keys may be added; those that are here keep their meaning.
"""

from typing import Annotated, Literal, NotRequired, TypedDict

Text = Annotated[str, "the message as UTF-8; bytes that are no UTF-8 are escaped, as \\xff"]
Hex = Annotated[str, "the message's bytes, two hexadecimal digits each"]
Stamp = Annotated[int, "of a message with a key: seconds since 1970, or the sender's counter"]
LoopFrames = Annotated[int, "number of frame pairs in the loop that carries the message"]
Preset = Annotated[str | None, "name of the preset whose layout is shown; null for other layouts"]


class DisplayEvent(TypedDict):
    """The display came into view of a film, or left it, or another one took its place."""

    event: Literal["display"]
    time: Annotated[float, "of the camera frame, seconds"]
    frame: Annotated[str, "name of the camera frame"]
    corners: Annotated[
        list[list[float]] | None,
        "x and y, in pixels of the frame, of top left, top right, bottom right and bottom left of "
        "the displayed picture, whatever way up the camera was; null when it is gone",
    ]
    preset: NotRequired[Preset]


class PlacedEvent(TypedDict):
    """The display was found in one of two images."""

    event: Literal["display"]
    image: Annotated[str, "path of the image"]
    preset: Preset
    corners: Annotated[list[list[float]], "as in a film"]


class ClockEvent(TypedDict):
    """The display's clock was found or lost."""

    event: Literal["clock"]
    time: Annotated[float, "of the camera frame, seconds"]
    state_hz: Annotated[float | None, "states that the display shows in a second; null when lost"]


class PairEvent(TypedDict):
    """A frame pair was decoded."""

    event: Literal["pair"]
    pair: Annotated[int, "number of the frame pair, counted from an arbitrary start"]
    time: Annotated[float, "of the camera frame with which it was decoded, seconds"]
    erased: Annotated[int, "number of message blocks without a score"]
    confidence: Annotated[float, "mean probability of the decisions, 0.5 to 1"]
    frames: Annotated[list[int], "number of camera frames in each of the two states"]
    progress: Annotated[float, "information received, as a share of what the message needs"]
    bits: NotRequired[Annotated[str, "0 or 1 for each message block, row by row"]]
    scores: NotRequired[
        Annotated[list[float], "natural log-likelihood ratios of the bits, positive for 1"]
    ]


class MessageEvent(TypedDict):
    """The message is whole."""

    event: Literal["message"]
    text: Text
    hex: Hex
    loop_frames: LoopFrames
    pairs_used: Annotated[int, "number of frame pairs whose scores were used"]
    confidence: Annotated[float, "share of the scores' weight that agrees with the message"]
    changed: NotRequired[Annotated[Literal[True], "another message was delivered before"]]
    stamp: NotRequired[Stamp]
    signed: NotRequired[
        Annotated[Literal["not checked"], "the message has a tag, and the receiver no key"]
    ]


class RefusedEvent(TypedDict):
    """A message came whole and is not delivered, because the receiver has a key."""

    event: Literal["refused"]
    reason: Annotated[str, "why, in words"]
    stale: Annotated[bool, "whether the tag fits but the stamp is too old"]
    bytes: Annotated[int, "length of the message"]
    loop_frames: LoopFrames
    text: NotRequired[Text]
    hex: NotRequired[Hex]
    stamp: NotRequired[Stamp]


class EndEvent(TypedDict):
    """The input is over."""

    event: Literal["end"]
    frames: Annotated[int, "number of camera frames taken"]
    frames_with_display: Annotated[int, "number of them in which the display was found"]
    seconds: Annotated[float, "time of the last frame"]
    message: Annotated[str | None, "text of the message that was delivered last"]
    milliseconds: Annotated[dict[str, float], "mean time of each stage, by its name"]


FilmEvent = DisplayEvent | ClockEvent | PairEvent | MessageEvent | RefusedEvent | EndEvent
Event = FilmEvent | PlacedEvent
