/**
 * Bundles the pages for browsers: node host/build.mjs DIR, where `python -m web` has put the
 * graphs, the presets, the player and the icons.
 */

import { createHash } from "node:crypto";
import { cp, mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";
import { dirname, join, relative, sep } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const WEB = dirname(dirname(fileURLToPath(import.meta.url)));
const PAGE = join(WEB, "page");
const OPENCV = "4.12.0"; // host/opencv/build.sh names it too
/**
 * Texts and scripts of the pages that stand in frame.html around their content, by the name of the
 * page.
 */
const PAGES = {
  "index.html": {
    script: "page.js",
    title: "Read a display",
    description: "Reads messages that are hidden in a picture on a display.",
  },
  "send.html": {
    script: "send.js",
    title: "Send from a display",
    description: "Hides a message in a picture that a display shows.",
  },
  "about.html": {
    script: "about.js",
    title: "How it works",
    description: "How a picture on a display carries a message to a camera.",
  },
};
const COPIED = ["style.css", "manifest.webmanifest", "icon.svg"];
const { dependencies } = JSON.parse(await readFile(join(WEB, "package.json"), "utf8"));

const out = process.argv[2];
if (!out) throw new Error("name the folder of the site: node host/build.mjs DIR");

const BLANK = "0123456789abcdef"; // stands for the version until all files are there

/** @type {import("esbuild").BuildOptions} */
const SETTINGS = {
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  platform: "browser",
  external: ["fs", "path", "crypto"],
  legalComments: "none",
  logLevel: "warning",
};

/**
 * List the files of a folder and of those below it.
 *
 * @param {string} folder
 * @returns {Promise<string[]>} paths relative to the folder, with slashes, sorted
 */
async function filesOf(folder) {
  const entries = await readdir(folder, { recursive: true, withFileTypes: true });
  return entries
    .filter((entry) => entry.isFile())
    .map((entry) => relative(folder, join(entry.parentPath, entry.name)).split(sep).join("/"))
    .sort();
}

/** @returns {Promise<string>} the versions of the packages and their licences */
async function licences() {
  const texts = [];
  for (const name of Object.keys(dependencies)) {
    const folder = join(WEB, "node_modules", name);
    const { version, license, repository } = JSON.parse(
      await readFile(join(folder, "package.json"), "utf8"),
    );
    const text = await readFile(join(folder, "LICENSE"), "utf8").catch(() => "");
    texts.push(`${name} ${version} (${license}), ${repository.url}\n\n${text}`);
  }
  const opencv = await readFile(join(WEB, "host/opencv/LICENSE"), "utf8");
  texts.push(`opencv ${OPENCV} (Apache-2.0), https://github.com/opencv/opencv\n\n${opencv}`);
  return texts.join("\n");
}

await mkdir(out, { recursive: true });
for (const name of COPIED) await cp(join(PAGE, name), join(out, name));
const frame = await readFile(join(PAGE, "frame.html"), "utf8");
for (const [name, words] of Object.entries(PAGES)) {
  const parts = { version: BLANK, content: await readFile(join(PAGE, name), "utf8"), ...words };
  const page = Object.entries(parts).reduce(
    (text, [at, part]) => text.replaceAll(`{{${at}}}`, () => part),
    frame,
  );
  await writeFile(join(out, name), page);
}
const ort = join(WEB, "node_modules/onnxruntime-web/dist/ort-wasm-simd-threaded");
await cp(`${ort}.wasm`, join(out, "ort.wasm"));
await cp(`${ort}.mjs`, join(out, "ort.js")); // not every host knows what .mjs is
await cp(join(WEB, "host/opencv/opencv.wasm"), join(out, "opencv.wasm"));
await writeFile(join(out, "licences.txt"), await licences());
const sent = join(out, "send.json");
const define = {
  VERSION: JSON.stringify(BLANK),
  VERSIONS: JSON.stringify({ ...dependencies, opencv: OPENCV }),
  SENT: await readFile(sent, "utf8"),
};
await rm(sent);
const scripts = ["page", "worker", "decoding", "send", "sending", "about"];
const entryPoints = scripts.map((name) => join(PAGE, `${name}.js`));
await build({ ...SETTINGS, define, entryPoints, outdir: out });

await writeFile(join(out, "version.txt"), BLANK);
const files = await filesOf(out);
await build({
  ...SETTINGS,
  define: { FILES: JSON.stringify(files), VERSION: JSON.stringify(BLANK) },
  entryPoints: [join(PAGE, "serviceWorker.js")],
  outdir: out,
});
const hash = createHash("sha256");
for (const name of files) hash.update(name).update(await readFile(join(out, name)));
const version = hash.digest("hex").slice(0, BLANK.length);
for (const name of [...files, "serviceWorker.js"].filter((name) => /\.(js|html|txt)$/.test(name))) {
  const text = await readFile(join(out, name), "utf8");
  await writeFile(join(out, name), text.replaceAll(BLANK, version));
}
