"""Scripts that stand in for the page's worker, and answer as a test says."""

import json

from web.host.site import WEB

WORKER = """
let answers = %s;
const usual = { last: false, width: 64, height: 48, corners: null, preset: null,
  synchronised: false, progress: 0, level: 120, clipped: 0, cut: false, explanation: "",
  found: 0, neededFps: 0,
  arrival: null };
async function answered(last) {
  const answer = answers.length > 1 ? answers.shift() : answers[0];
  if (answer.arrival) answer.arrival.data = new TextEncoder().encode(answer.arrival.text);
  await new Promise((resolve) => setTimeout(resolve, 30));
  return { ...usual, last: last && !answer.arrival, ...answer };
}
expose({
  load() {},
  warm() {},
  start() {},
  record: () => null,
  finish: () => answered(true),
  take({ frame }) {
    frame?.close();
    return answered(false);
  },
});
"""
"""A worker that answers after 30 ms; what an answer does not say is usual. A list of answers, as
JSON, takes the place of the format."""
CORNERS = [[10, 8], [50, 6], [52, 40], [9, 41]]
"""Corners of the display that the worker answers with, pixels of a frame of 64 x 48."""


def with_comlink(script: str) -> str:
    """Put the library through which the page calls its worker before a script."""
    return (WEB / "node_modules/comlink/dist/esm/comlink.mjs").read_text() + script


def answering(*answers) -> str:
    """Script of a worker that gives an answer a frame, and the last one again and again."""
    return with_comlink(WORKER % json.dumps(answers))


def arrived(text: str, **more) -> dict:
    """Answer of a worker to which a message has arrived."""
    arrival = {"text": text, "refused": None, "stale": False, "stamp": None, **more}
    return {"progress": 1, "corners": CORNERS, "synchronised": True, "arrival": arrival}
