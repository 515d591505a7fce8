/**
 * Bundles the npm package's script: node package/build.mjs DIR. What it takes from other packages stays
 * an import, and the names of these packages are printed as JSON.
 */

import { join } from "node:path";
import { build } from "esbuild";

const { metafile } = await build({
  entryPoints: ["package/index.js"],
  outfile: join(process.argv[2], "index.js"),
  bundle: true,
  packages: "external",
  format: "esm",
  target: "es2022",
  platform: "neutral",
  metafile: true,
  logLevel: "warning",
});
const [{ imports }] = Object.values(metafile.outputs);
const names = imports.map(({ path }) => path.match(/^(@[^/]+\/)?[^/]+/)?.[0]);
console.log(JSON.stringify([...new Set(names)].sort()));
