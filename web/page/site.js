/** Files of the site, and files that it makes. */

/** @param {string} name @returns {string} address of a file of the site */
export function addressOf(name) {
  return new URL(name, self.location.href).href;
}

/**
 * Load a file of the site.
 *
 * @param {string} name
 * @returns {Promise<Response>}
 * @throws {Error} it is not there
 */
export async function load(name) {
  const response = await fetch(addressOf(name));
  if (!response.ok) throw new Error(`${name} is missing on the server`);
  return response;
}

/** Keep all pages on the device; they work without this as long as there is a network. */
export async function keepForOffline() {
  await navigator.serviceWorker?.register(addressOf("serviceWorker.js")).catch(() => {});
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
