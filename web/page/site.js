/** Files of the site, files that it makes, and files that it is given. */

/** Why the files of an older build are given up; who sees it needs the newer ones. */
export const RENEWED = "this page is older than what its server has now";

/** @param {string} name @returns {string} address of a file of the site, of this page's build */
export function addressOf(name) {
  return new URL(`${name}?v=${VERSION}`, self.location.href).href;
}

/** Take away the note that stands on the page where its program does not run. */
export function started() {
  document.getElementById("trouble")?.remove();
}

/**
 * Load a file of the site.
 *
 * @param {string} name
 * @returns {Promise<Response>}
 * @throws {Error} it is not there, or the site was built anew since this page was opened
 */
export async function load(name) {
  const response = await fetch(addressOf(name));
  if (!response.ok) throw new Error(`${name} is missing on the server`);
  await checkVersion();
  return response;
}

/**
 * Make sure that the site's files are those that this page was built with.
 *
 * @throws {Error} they are not
 */
export async function checkVersion() {
  const response = await fetch(addressOf("version.txt"), { cache: "no-store" });
  if (response.ok && (await response.text()) !== VERSION) throw new Error(RENEWED);
}

/** @param {string} name @returns {string} what was remembered by this name; empty where nothing was */
export function remembered(name) {
  try {
    return localStorage.getItem(name) ?? "";
  } catch {
    return ""; // where pages may keep nothing
  }
}

/** @param {string} name @param {string} value - is remembered on this device */
export function remember(name, value) {
  try {
    localStorage.setItem(name, value);
  } catch {
    // it is chosen anew next time
  }
}

/** Keep all pages on the device; they work without this as long as there is a network. */
export async function keepForOffline() {
  const address = new URL("serviceWorker.js", self.location.href).href; // whose name stays the same
  await navigator.serviceWorker?.register(address).catch(() => {});
}

/**
 * Give a file to the visitor.
 *
 * @param {Blob} file
 * @param {string} name
 */
export function download(file, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60e3);
}

/**
 * Take the files that a visitor drops on the page, or pastes.
 *
 * @param {string[]} names - of the events that are heeded
 * @param {HTMLElement} view - shows that a file is over the page
 * @param {(file: File) => void} take
 */
export function takeFiles(names, view, take) {
  for (const name of names) {
    document.addEventListener(name, (event) => {
      const given = /** @type {any} */ (event)[name === "paste" ? "clipboardData" : "dataTransfer"];
      const [file] = given?.files ?? [];
      if (name !== "paste" || file) event.preventDefault(); // text goes where it is pasted
      view.classList.toggle("over", name === "dragover");
      if (file && !name.startsWith("drag")) take(file);
    });
  }
}
