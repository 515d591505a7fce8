/** Films whose bytes come in chunks, as the page reads them. */

import { readY4m } from "../src/page/y4m.js";

/** @param {Uint8Array} bytes @param {number} size @returns {ReadableStream<Uint8Array>} */
function streamOf(bytes, size) {
  let at = 0;
  return new ReadableStream({
    pull(controller) {
      if (at >= bytes.length) return controller.close();
      controller.enqueue(bytes.slice(at, (at += size)));
    },
  });
}

/** @param {Uint8Array} bytes @param {number} size of the stream's chunks */
export async function framesOf(bytes, size) {
  const frames = [];
  for await (const frame of readY4m(streamOf(bytes, size))) frames.push(frame);
  return frames;
}
