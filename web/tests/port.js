/**
 * Answers Python's tests: calls what the modules of `port` export, and keeps the objects that they make.
 *
 * `tests/web/port.py` writes one request a line and reads one answer a line, both JSON. Arrays of
 * numbers travel as base64 of their bytes. What is no plain data stays here and travels as a number.
 */

import { readFileSync } from "node:fs";
import { createInterface } from "node:readline";

console.log = console.error; // standard output carries nothing but answers
const { loadOpenCv } = await import("../port/image/opencv.js");
const { Layout } = await import("../port/link/layout.js");

/** Objects that Python knows by their numbers. @type {any[]} */
let kept = [];

/** @type {Record<string, any>} */
const ARRAYS = { Uint8Array, Uint16Array, Uint32Array, Int32Array, Float32Array, Float64Array };

/**
 * Make what Python sent.
 *
 * @param {string} _ - name
 * @param {any} value
 */
function decoded(_, value) {
  if (value === null || typeof value !== "object") return value;
  if ("$array" in value) {
    const bytes = Uint8Array.from(Buffer.from(value.base64, "base64"));
    return new ARRAYS[value.$array](bytes.buffer);
  }
  if ("$number" in value) return Number(value.$number);
  if ("$layout" in value) return new Layout(value.$layout);
  return "$kept" in value ? kept[value.$kept] : value;
}

/**
 * Describe a value to Python.
 *
 * @param {any} value
 * @returns {any} of JSON's types
 */
function encoded(value) {
  if (value === undefined) return null;
  if (typeof value === "number" && !Number.isFinite(value)) return { $number: String(value) };
  if (value === null || !["object", "function"].includes(typeof value)) return value;
  if (value instanceof ArrayBuffer) return encoded(new Uint8Array(value));
  if (ArrayBuffer.isView(value)) {
    const bytes = Buffer.from(value.buffer, value.byteOffset, value.byteLength);
    return { $array: value.constructor.name, base64: bytes.toString("base64") };
  }
  if (Array.isArray(value)) return Array.from(value, encoded);
  if (Object.getPrototypeOf(value) === Object.prototype) {
    return Object.fromEntries(Object.entries(value).map(([name, part]) => [name, encoded(part)]));
  }
  if (!kept.includes(value)) kept.push(value);
  return { $kept: kept.indexOf(value) };
}

/** @param {any} member - of an object or a module */
function isClass(member) {
  return /^class\b/.test(Function.prototype.toString.call(member));
}

/**
 * Do what a request says.
 *
 * @param {any} request - `of` is a module's path within `src`, or an object; `name` is a member's,
 *   or null for the object itself, `given` what it is called with, `value` what it becomes
 * @returns {Promise<any>}
 */
async function answer({ of, name, given, value }) {
  if (of === null) {
    kept = [];
    return null;
  }
  const target = typeof of === "string" ? await import(`../port/${of}`) : of;
  if (value !== undefined) {
    target[name] = value;
    return null;
  }
  const member = name === null ? target : target[name];
  if (member === undefined && !(name in target)) throw new Error(`there is no ${name}`);
  if (given !== undefined) {
    return encoded(isClass(member) ? new member(...given) : await member.apply(target, given));
  }
  const isFunction = typeof member === "function" && !isClass(member);
  return isFunction ? { $function: name } : encoded(member);
}

await loadOpenCv(new Uint8Array(readFileSync(new URL("../host/opencv/opencv.wasm", import.meta.url))));
for await (const line of createInterface({ input: process.stdin })) {
  const said = await answer(JSON.parse(line, decoded)).then(
    (result) => ({ result }),
    (error) => ({ error: String(error?.stack ?? error) }),
  );
  process.stdout.write(`${JSON.stringify(said)}\n`);
}
