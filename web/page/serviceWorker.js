/**
 * Keeps all pages on the device, so that they open without a network.
 *
 * build.mjs lists the files and changes the version whenever one of them changes. A new version is
 * loaded as a whole, and takes over at once; pages that are open notice by version.txt.
 */

const scope = /** @type {any} */ (self);
const CACHE = `receiver-${VERSION}`;

/**
 * What a worker may do: run its own code, WebAssembly included, load from where it came from, and
 * start the other worker. A host's own rules, where there are any, hold as well.
 */
const WORKERS = ["worker.js", "decoding.js", "sending.js"];
const WORKER_POLICY =
  "default-src 'none'; connect-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'";

scope.addEventListener("install", (/** @type {any} */ event) => {
  event.waitUntil(
    caches.open(CACHE).then(async (cache) => {
      await Promise.all(FILES.map((name) => keep(cache, name)));
      const kept = await cache.match("version.txt");
      if ((await kept?.text()) !== VERSION) throw new Error("the site is being renewed");
      await scope.skipWaiting();
    }),
  );
});

/**
 * Keep a file. Where the host redirects its address, what it leads to is kept: browsers refuse to
 * show a page whose response was redirected.
 *
 * @param {Cache} cache
 * @param {string} name
 */
async function keep(cache, name) {
  const { ok, body, headers } = await fetch(name, { cache: "no-cache" });
  if (!ok) throw new Error(`${name} is missing on the server`);
  await cache.put(name, new Response(body, { headers }));
}

scope.addEventListener("activate", (/** @type {any} */ event) => {
  event.waitUntil(
    caches.keys().then(async (names) => {
      const old = names.filter((name) => name.startsWith("receiver-") && name !== CACHE);
      await Promise.all(old.map((name) => caches.delete(name)));
    }),
  );
});

scope.addEventListener("fetch", (/** @type {any} */ event) => {
  const { request } = event;
  const root = new URL(scope.registration.scope).pathname;
  const name = new URL(request.url).pathname.slice(root.length);
  const known = [name, `${name || "index"}.html`].find((each) => FILES.includes(each)); // as of "send"
  if (request.method !== "GET" || known === undefined) return;
  event.respondWith(
    caches.open(CACHE).then(async (cache) => {
      const kept = await cache.match(known);
      if (!kept || !WORKERS.includes(known)) return kept ?? fetch(request);
      const headers = new Headers(kept.headers);
      headers.set("Content-Security-Policy", WORKER_POLICY);
      return new Response(kept.body, { headers });
    }),
  );
});
