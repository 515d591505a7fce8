/**
 * Reads a film as the page's worker does, without a browser: node read.js SITE FILM.y4m
 *
 * SITE is a folder that `python -m web` wrote, and FILM.y4m a film without compression, as
 * `ffmpeg -i film.mp4 -pix_fmt yuv420p FILM.y4m` writes it.
 * Prints one line of JSON: the message's bytes in base64 or null, the film's time and the number of
 * frames until then, the seconds that the receiver took for them, by stage and in all, and the
 * memory that the process took, in bytes.
 */

import { openSync, readFileSync, readSync } from "node:fs";
import { join } from "node:path";
import { FilmGraph } from "./port/export/filmGraph.js";
import { loadOpenCv } from "./port/image/opencv.js";
import { Layout } from "./port/link/layout.js";
import { Receiver } from "./port/receiver/receiver.js";

const [site, film] = process.argv.slice(2);
if (!film) throw new Error("name the site and the film: node read.js SITE FILM.y4m");

/**
 * Read the frames of a film.
 *
 * @returns {Generator<{ plane: BytePlane, time: number, fps: number }>}
 */
function* framesOf() {
  const file = openSync(film, "r");
  const start = Buffer.alloc(100);
  readSync(file, start, 0, start.length, 0);
  const [line, ...numbers] = /^YUV4MPEG2 W(\d+) H(\d+) F(\d+):(\d+) .*\n/.exec(start.toString()) ?? [];
  if (!line) throw new Error(`${film} is no film of the kind y4m`);
  const [width, height, frames, seconds] = numbers.map(Number);
  const [fps, area] = [frames / seconds, width * height];
  const step = "FRAME\n".length + area + 2 * Math.ceil(width / 2) * Math.ceil(height / 2);
  for (let number = 0; ; number++) {
    const data = new Uint8Array(area);
    const at = line.length + number * step + "FRAME\n".length;
    if (readSync(file, data, 0, area, at) < area) return;
    yield { plane: { width, height, data }, time: number / fps, fps };
  }
}

await loadOpenCv(new Uint8Array(readFileSync(join(site, "opencv.wasm"))));
/** @type {{ layout: any }[]} */
const presets = JSON.parse(readFileSync(join(site, "presets.json"), "utf8"));
const layouts = presets.map(({ layout }) => new Layout(layout));
const filmGraph = new FilmGraph(new Uint8Array(readFileSync(join(site, "models/film.onnx"))));
await filmGraph.load();
/** @type {Receiver | null} */
let receiver = null;
let message = null;
let seconds = 0;
let last = 0;
for (const { plane, time, fps } of framesOf()) {
  receiver ??= new Receiver(layouts, filmGraph, fps);
  const start = performance.now();
  const step = await receiver.push(plane, time);
  seconds += (performance.now() - start) / 1000;
  last = time;
  message = step.message;
  if (message) break;
}
if (!receiver) throw new Error(`${film} has no frames`);
const { frames, found } = receiver;
const stages = receiver.timing.spent;
const data = message && Buffer.from(message.data).toString("base64");
const memory = process.memoryUsage().rss;
console.log(JSON.stringify({ data, time: last, frames, found, seconds, stages, memory }));
