/** The camera: the best one, at its highest rate, with the controls that it offers. */

/** Width and height, in pixels, that are asked for; more would only be slower to look through. */
const SIZE = { width: 1280, height: 720 };

/** Frames a second that are asked for first; the camera's highest rate follows. */
const USUAL_FPS = 60;

/**
 * A setting of the camera that browsers may offer and TypeScript does not know yet.
 *
 * @typedef {Record<string, any>} Settings
 */

/**
 * Open a camera.
 *
 * @param {string} deviceId - of the camera that is preferred; where it is empty or that camera is
 *   gone, one that looks away from the user
 * @returns {Promise<MediaStream>}
 * @throws {Error} its name says why, as `cameraTrouble` explains
 */
export async function openCamera(deviceId) {
  if (!navigator.mediaDevices?.getUserMedia) {
    const error = new Error("no camera without https");
    error.name = "InsecureContext";
    throw error;
  }
  /** @param {MediaTrackConstraints} which */
  const open = (which) =>
    navigator.mediaDevices.getUserMedia({
      audio: false,
      video: {
        ...which,
        width: { ideal: SIZE.width },
        height: { ideal: SIZE.height },
        frameRate: { ideal: USUAL_FPS },
      },
    });
  const stream = await open(
    deviceId ? { deviceId: { exact: deviceId } } : { facingMode: "environment" },
  ).catch((error) => {
    if (!deviceId || error.name !== "OverconstrainedError") throw error;
    return open({ facingMode: "environment" }); // as the camera is gone
  });
  await raiseRate(stream.getVideoTracks()[0]);
  return stream;
}

/**
 * Ask for the highest rate that the camera has at the size that it gives.
 *
 * @param {MediaStreamTrack} track
 */
async function raiseRate(track) {
  const highest = track.getCapabilities?.().frameRate?.max;
  const { width, height, frameRate } = track.getSettings();
  if (!highest || !width || !height || (frameRate ?? 0) >= highest) return;
  const size = { width: { exact: width }, height: { exact: height } };
  await apply(track, { ...size, frameRate: { ideal: highest } });
}

/**
 * Change settings of a camera; one that refuses keeps those that it has.
 *
 * @param {MediaStreamTrack} track
 * @param {Settings} settings
 * @returns {Promise<boolean>} whether it took them
 */
async function apply(track, settings) {
  try {
    await track.applyConstraints(settings);
    return true;
  } catch {
    return false;
  }
}

/**
 * Expose each frame for a shorter time, and raise the gain by as much, where the browser lets a
 * page do both.
 *
 * @param {MediaStreamTrack} track
 * @param {number} factor - of the time, below 1
 * @returns {Promise<boolean>} whether frames are exposed for a shorter time now
 */
export async function shortenExposure(track, factor) {
  /** @type {Settings} */
  const { exposureMode = [], exposureTime: times, iso: gains } = track.getCapabilities?.() ?? {};
  /** @type {Settings} */
  const { exposureTime, iso } = track.getSettings();
  if (!exposureMode.includes("manual") || !times || !exposureTime || !gains || !iso) return false;
  const shorter = Math.max(times.min, exposureTime * factor);
  const setting = {
    exposureMode: "manual",
    exposureTime: shorter,
    iso: Math.min(gains.max, (iso * exposureTime) / shorter),
  };
  return shorter < exposureTime && apply(track, /** @type {any} */ ({ advanced: [setting] }));
}

/**
 * A control of the camera: a switch, or a slider from one number to another.
 *
 * @typedef {object} Control
 * @property {string} name - what the user reads
 * @property {{ min: number, max: number, step: number, value: number }} [range] - of a slider
 * @property {(value: number) => Promise<boolean>} set - takes 0 or 1, or a number in the range
 */

/**
 * List what can be set: torch, zoom, exposure, and whether exposure and focus stay as they are.
 *
 * @param {MediaStreamTrack} track
 * @returns {Control[]} those that this camera and this browser offer
 */
export function cameraControls(track) {
  /** @type {Settings} */
  const able = track.getCapabilities?.() ?? {};
  /** @type {Settings} */
  const now = track.getSettings();
  /** @param {Settings} setting */
  const set = (setting) => apply(track, { advanced: [setting] });
  /** @type {Control[]} */
  const controls = [];
  for (const [key, name] of Object.entries({ zoom: "Zoom", exposureCompensation: "Exposure" })) {
    const { min, max, step } = able[key] ?? {};
    if (!(max > min)) continue;
    const range = { min, max, step: step || (max - min) / 100, value: now[key] ?? min };
    controls.push({ name, range, set: (value) => set({ [key]: value }) });
  }
  if (able.torch) controls.push({ name: "Torch", set: (on) => set({ torch: Boolean(on) }) });
  const locks = { exposureMode: "Lock exposure", focusMode: "Lock focus" };
  for (const [key, name] of Object.entries(locks)) {
    const modes = able[key] ?? [];
    if (!modes.includes("manual") || !modes.includes("continuous")) continue;
    controls.push({ name, set: (on) => set({ [key]: on ? "manual" : "continuous" }) });
  }
  return controls;
}

/**
 * List the cameras; browsers tell their names only once one of them may be used.
 *
 * @returns {Promise<{ id: string, name: string }[]>}
 */
export async function listCameras() {
  const devices = (await navigator.mediaDevices?.enumerateDevices?.()) ?? [];
  return devices
    .filter((device) => device.kind === "videoinput")
    .map((device, i) => ({ id: device.deviceId, name: device.label || `Camera ${i + 1}` }));
}
