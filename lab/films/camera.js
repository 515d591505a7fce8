/**
 * A camera that plays a film in the film's own time, for a page in Chromium.
 *
 * Chromium's own simulated camera plays a film slower where the machine is busy, and no real camera
 * does. So a page that loads this script is given this camera in place of its own. Its frames come
 * from a worker, which loads the script, too, from the site's `camera.js`, and beside it `film.y4m`.
 * Frames that cannot be given in time are lost.
 */

/** Let the page's camera be this one. */
function replaceCamera() {
  navigator.mediaDevices.getUserMedia = async () => {
    const track = new MediaStreamTrackGenerator({ kind: "video" });
    const { writable } = track;
    const worker = new Worker("/camera.js");
    worker.postMessage(writable, [writable]);
    const stop = track.stop.bind(track);
    track.stop = () => {
      worker.terminate();
      stop();
    };
    return new MediaStream([track]);
  };
}

/** Bytes of the film, in order. */
class Film {
  #reader;
  #rest = new Uint8Array(0);

  /** @param {ReadableStream<Uint8Array>} body */
  constructor(body) {
    this.#reader = body.getReader();
  }

  /**
   * Fill an array with the next bytes.
   *
   * @param {Uint8Array} bytes
   * @returns {Promise<boolean>} whether there were enough
   */
  async fill(bytes) {
    for (let at = 0; at < bytes.length; ) {
      if (this.#rest.length === 0) {
        const { value, done } = await this.#reader.read();
        if (done) return false;
        this.#rest = value;
      }
      const part = this.#rest.subarray(0, bytes.length - at);
      bytes.set(part, at);
      at += part.length;
      this.#rest = this.#rest.subarray(part.length);
    }
    return true;
  }
}

/**
 * Give the frames of the film, each at its time.
 *
 * @param {WritableStream<VideoFrame>} writable - takes the frames
 */
async function play(writable) {
  const film = new Film((await fetch("/film.y4m")).body);
  const writer = writable.getWriter();
  let line = "";
  for (const byte = new Uint8Array(1); !line.endsWith("\n"); line += String.fromCharCode(byte[0])) {
    if (!(await film.fill(byte))) throw new Error("film.y4m has no frames");
  }
  const [codedWidth, codedHeight, rate] = /W(\d+) H(\d+) F(\d+):1000/.exec(line).slice(1).map(Number);
  const frameMs = 1e6 / rate;
  const colorSpace = { fullRange: true };
  const head = new Uint8Array("FRAME\n".length);
  const planes = new Uint8Array(1.5 * codedWidth * codedHeight);
  const begun = performance.now();
  for (let number = 0; (await film.fill(head)) && (await film.fill(planes)); number++) {
    const early = begun + number * frameMs - performance.now();
    if (early > 0) await new Promise((resolve) => setTimeout(resolve, early));
    if (early < -frameMs || writer.desiredSize <= 0) continue;
    const timestamp = Math.round(1e3 * number * frameMs);
    const init = { format: "I420", codedWidth, codedHeight, timestamp, colorSpace };
    void writer.write(new VideoFrame(planes, init)); // which closes it
  }
}

if (typeof document === "undefined") onmessage = ({ data }) => play(data);
else replaceCamera();
