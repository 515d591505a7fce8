/**
 * Bundles the npm package's scripts: node package/build.mjs DIR. What it takes from other packages stays
 * an import, and the names of these packages are printed as JSON.
 */

import { copyFile } from "node:fs/promises";
import { join } from "node:path";
import { build } from "esbuild";

const { metafile } = await build({
  entryPoints: ["package/index.js", "package/live.js", "package/errors.js"],
  outdir: process.argv[2],
  splitting: true,
  bundle: true,
  packages: "external",
  format: "esm",
  target: "es2022",
  platform: "neutral",
  metafile: true,
  logLevel: "warning",
});
await copyFile("package/worker.js", join(process.argv[2], "worker.js")); // bundlers find it by its address
const imports = Object.values(metafile.outputs).flatMap(({ imports }) => imports);
const names = imports.filter(({ external }) => external).map(({ path }) => path.match(/^(@[^/]+\/)?[^/]+/)?.[0]);
console.log(JSON.stringify([...new Set(names)].sort()));
