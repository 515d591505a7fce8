/**
 * Reads a film as the page's worker does, without a browser: node read.js SITE FILM.y4m
 *
 * SITE is a folder that `python -m export.web` wrote. Prints one line of JSON: the message's bytes
 * in base64 or null, the film's time and the number of frames until then, the seconds that the
 * receiver took for them, by stage and in all, and the memory that the process took, in bytes.
 */

import { createReadStream, readFileSync } from "node:fs";
import { join } from "node:path";
import { Readable } from "node:stream";
import { Decoder } from "./src/decoder.js";
import { FilmGraph } from "./src/filmGraph.js";
import { loadOpenCv } from "./src/image/opencv.js";
import { Layout } from "./src/link/layout.js";
import { readY4m } from "./src/page/y4m.js";
import { Receiver } from "./src/receive/receiver.js";

const [site, film] = process.argv.slice(2);
if (!film) throw new Error("name the site and the film: node read.js SITE FILM.y4m");

/** @returns {Promise<Decoder[]>} the decoders of the site, ready */
async function loadDecoders() {
  /** @type {{ layout: any, model: string }[]} */
  const presets = JSON.parse(readFileSync(join(site, "presets.json"), "utf8"));
  const decoders = presets.map(
    ({ layout, model }) =>
      new Decoder(new Layout(layout), new Uint8Array(readFileSync(join(site, model)))),
  );
  for (const decoder of decoders) await decoder.load();
  return decoders;
}

await loadOpenCv(new Uint8Array(readFileSync(join(site, "opencv.wasm"))));
const decoders = await loadDecoders();
const filmGraph = new FilmGraph(new Uint8Array(readFileSync(join(site, "models/film.onnx"))));
await filmGraph.load();
/** @type {Receiver | null} */
let receiver = null;
let message = null;
let seconds = 0;
let last = 0;
const stream = /** @type {ReadableStream<Uint8Array>} */ (Readable.toWeb(createReadStream(film)));
for await (const { plane, time, fps } of readY4m(stream)) {
  receiver ??= new Receiver(decoders, fps, Infinity, filmGraph);
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
