// SPDX-License-Identifier: Apache-2.0
// node viewer_test.mjs STILLMAP: the built-in page in a real browser, headless, while the program plays a log.
import assert from "node:assert/strict";
import { spawn, spawnSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { setTimeout as sleep } from "node:timers/promises";

import { McapStreamReader } from "@mcap/core";
import puppeteer from "puppeteer-core";

const source = process.env.STILLMAP_SOURCE_DIR, shared = process.env.STILLMAP_SHARED ?? path.join(source, "..", "shared");
const browserPath = ["chromium", "chromium-browser", "google-chrome"].map((name) =>
    spawnSync("sh", ["-c", `command -v ${name}`]).stdout.toString().trim()).find(Boolean);
if (!browserPath) {
  console.log("skipped: no browser; install chromium");
  process.exit(77);
}
const folder = mkdtempSync(path.join(tmpdir(), "stillmap-viewer-"));
process.on("exit", () => rmSync(folder, { recursive: true, force: true }));

/// A log forwards and backwards for as long as the test takes, and the options that go with it: the recorded one with
/// people drawn in, or the rendered one where that is missing.
function endlessLog() {
  const recorded = path.join(shared, "data/fr1_rpy_walkers"), model = path.join(shared, "models/nanodet_plus_m/nanodet_plus_m_int8.onnx");
  const there = existsSync(recorded) && existsSync(model);
  const from = there ? recorded : path.join(process.env.STILLMAP_TEST_LOGS, "log");
  const lines = readFileSync(path.join(from, "associations.txt"), "utf8").split("\n").filter((l) => l && l[0] !== "#").map((l) => l.split(/\s+/));
  const to = path.join(folder, "log");
  mkdirSync(to);
  for (const kind of ["rgb", "depth"]) symlinkSync(path.join(from, kind), path.join(to, kind));
  const there_and_back = [...lines, ...lines.slice(1, -1).reverse()];
  const long = Array.from({ length: 20_000 }, (_, i) => [i, there_and_back[i % there_and_back.length]]);
  writeFileSync(path.join(to, "associations.txt"), long.map(([i, [, colour, , depth]]) => {
    const t = (1 + i / 30).toFixed(6);
    return `${t} ${colour} ${t} ${depth}\n`;
  }).join(""));
  const camera = path.join(source, "firmware-config/cameras", there ? "tum-fr1.toml" : "synthetic.toml");
  const detector = there ? ["--set", `detector.model=${model}`]
                         : ["--config", path.join(source, "firmware-config/demo.toml"), "--set", `detector.model=${path.join(process.env.STILLMAP_TEST_LOGS, "demo.onnx")}`];
  return ["run", "--config", camera, ...detector, "--source", `tum:${to}`, "--mode", "lockstep", "--detector-every", "3"];
}
const args = endlessLog();

/// Starts the program; resolves with its port when it listens.
function start(port) {
  const program = spawn(process.argv[2], [...args, "--listen", `127.0.0.1:${port}`], { stdio: ["ignore", "ignore", "pipe"] });
  process.on("exit", () => program.kill("SIGKILL"));
  return new Promise((resolve, reject) => {
    let words = "";
    program.stderr.on("data", (text) => {
      words += text;
      const listening = /http:\/\/127\.0\.0\.1:(\d+) /.exec(words);
      if (listening) resolve({ program, port: Number(listening[1]) });
    });
    program.on("exit", () => reject(new Error(words)));
  });
}
async function stop(program) {
  const ended = new Promise((resolve) => program.once("exit", resolve));
  program.kill("SIGINT");
  await ended;
}
async function until(what, condition, timeout_ms = 240_000) {
  for (const end = Date.now() + timeout_ms; Date.now() < end; await sleep(100)) if (await condition()) return;
  assert.fail(`waited ${timeout_ms} ms for ${what}`);
}

/// What the canvas shows right after it was drawn: pixels that are not background, different colours among them, and how
/// many have about this colour.
const look = (page, colour = [0, 0, 0]) => page.evaluate((want) => new Promise((resolve) => requestAnimationFrame(() => {
  const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight], pixels = new Uint8Array(4 * w * h), colours = new Set();
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let drawn = 0, alike = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    const p = pixels.subarray(i, i + 3);
    if (Math.abs(p[0] - 16) + Math.abs(p[1] - 20) + Math.abs(p[2] - 26) > 9) { ++drawn; colours.add(p[0] >> 3 << 10 | p[1] >> 3 << 5 | p[2] >> 3); }
    if (Math.abs(p[0] - want[0]) + Math.abs(p[1] - want[1]) + Math.abs(p[2] - want[2]) < 45) ++alike;
  }
  resolve({ drawn: drawn / (w * h), colours: colours.size, alike });
})), colour);
/// Pixels of the preview with about this colour.
const previewPixels = (page, colour) => page.evaluate((want) => {
  const c = document.getElementById("picture"), d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
  let n = 0;
  for (let i = 0; i < d.length; i += 4) n += Math.abs(d[i] - want[0]) + Math.abs(d[i + 1] - want[1]) + Math.abs(d[i + 2] - want[2]) < 30;
  return n;
}, colour);
const words = (page, id) => page.$eval(`#${id}`, (e) => e.textContent);
const number = async (page, id) => Number((await words(page, id)).replace(/[^\d.]/g, ""));

let { program, port } = await start(0);
// The test's own end is the limit: a busy machine takes long for a browser.
const browser = await puppeteer.launch({ executablePath: browserPath, timeout: 0, protocolTimeout: 0,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"] });
process.on("exit", () => browser.process()?.kill("SIGKILL"));
const page = await browser.newPage(), requests = [], errors = [];
await page.setViewport({ width: 640, height: 480 });
page.on("request", (r) => requests.push(r.url()));
page.on("pageerror", (e) => errors.push(e.message));
const downloads = await page.createCDPSession();
await downloads.send("Browser.setDownloadBehavior", { behavior: "allow", downloadPath: folder });
await page.goto(`http://127.0.0.1:${port}/?token=of-no-use`, { timeout: 0 });
assert.ok(!page.url().includes("token"), "a token does not stay in the address");

// Counters.
await until("voxels and a state", async () => (await number(page, "voxels")) > 3000 && (await words(page, "state")) === "tracking");
for (const id of ["fps", "latency", "memory", "keyframes"]) assert.ok((await number(page, id)) > 0, id);
const [drops, fps] = [await words(page, "drops"), await number(page, "fps")];
assert.equal(drops, "0");
assert.ok(fps < 500);

// The preview: features that stand still in green, and the boxes of what may move.
await until("a preview with boxes and features", async () =>
  (await previewPixels(page, [66, 204, 115])) > 100 && (await previewPixels(page, [245, 166, 36])) + (await previewPixels(page, [240, 69, 69])) > 100);
assert.ok(await page.evaluate(() => picture.bitmap?.width > 100), "a picture came");

// Voxels are drawn, and nothing else makes these pixels.
await page.click("#pathButton");
await page.click("#objectsButton");
await page.evaluate(() => { camera = null; });
let withVoxels;
await until("voxels in the picture", async () => (withVoxels = await look(page)).drawn > 0.03 && withVoxels.colours > 100);
// Blocks that arrive in between are drawn: then once more.
await until("a picture without voxels", async () => {
  await page.evaluate(() => { window.kept = Math.max(map.used, window.kept ?? 0); map.used = 0; camera = null; });
  return (await look(page)).drawn < 0.3 * withVoxels.drawn;
});
await page.evaluate(() => { map.used = window.kept; });
// The path is drawn in its colour, and so are the objects' boxes.
const cyan = [77, 194, 255];
const before = await look(page, cyan);
await page.click("#pathButton");
await until("the path", async () => (await look(page, cyan)).alike > before.alike + 20);
await page.click("#objectsButton");
await until("a box in space", () => page.evaluate(() => objects.size > 0));

// From above one sees into the room: what lies over the camera is left out; from below it is there.
await until("a pose again", () => page.evaluate(() => camera !== null));
const overhead = (pitch) => page.evaluate((p) => {
  view.pitch = p;
  map.set(2_000_000, add(camera.p, basis()[0]).map((c) => Math.floor(c / map.voxel_m / 8)), new Uint8Array(64).fill(255), new Uint8Array(1536).fill(255));
}, pitch);
await overhead(1.4);
const from_above = await look(page, [255, 255, 255]);
await overhead(-1.4);
await until("a ceiling from below", async () => (await look(page, [172, 172, 172])).alike > from_above.alike + 100);
await page.evaluate(() => { map.set(2_000_000, [0, 0, 0], new Uint8Array(64), new Uint8Array(0)); view.pitch = 0.5; });

// Names of things that are beside each other can be read.
assert.ok(await page.evaluate(() => {
  placeLabels([0, 0.01, 0.02].map((x) => ({ at: [x, x, 0], words: "person 1.0 m/s", moves: true })), [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], 640, 480);
  const boxes = [...$("labels").children].filter((d) => !d.hidden).map((d) => d.getBoundingClientRect());
  return boxes.length === 3 && boxes.every((a) => boxes.every((b) => a === b || a.bottom <= b.top || b.bottom <= a.top));
}));

// Looking around: a drag turns, two fingers come nearer and end the following.
const state = () => page.evaluate(() => ({ yaw: view.yaw, distance: view.distance, follow: view.follow }));
const start_view = await state();
await page.mouse.move(200, 200);
await page.mouse.down();
await page.mouse.move(260, 220, { steps: 4 });
await page.mouse.up();
const touch = (type, points) => downloads.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
await touch("touchStart", [[200, 200]]);
await touch("touchStart", [[200, 200], [260, 200]]);
await touch("touchMove", [[180, 200], [290, 210]]);
await touch("touchEnd", []);
const turned = await state();
assert.ok(Math.abs(turned.yaw - start_view.yaw) > 0.1 && turned.distance < start_view.distance && !turned.follow, JSON.stringify(turned));
await page.click("#follow");
assert.ok((await state()).follow);

// On a phone, what lies over the map leaves most of it to see, and nothing lies over each other.
const size = page.viewport();
await page.setViewport({ width: 390, height: 844 });
const cards = await page.evaluate(() => ["strip", "tools", "preview"].map((id) => $(id).getBoundingClientRect().toJSON()));
assert.ok(cards.reduce((sum, c) => sum + c.width * c.height, 0) < 0.18 * 390 * 844, JSON.stringify(cards));
for (const a of cards) for (const b of cards) assert.ok(a === b || a.bottom <= b.top || b.bottom <= a.top, JSON.stringify(cards));
assert.ok(await page.evaluate(() => { aim(); return view.distance; }) > 5, "from as far as it takes to see as much as on a wide screen");
await page.setViewport(size);

// A figure past its limit has another colour.
assert.deepEqual(await page.evaluate(() => [0, 40, 200].map((ms) => { grade("latency", "", ms, 33, 100); return getComputedStyle($("latency")).color; })),
                 ["rgb(230, 235, 241)", "rgb(245, 165, 36)", "rgb(240, 69, 69)"]);

// Half a million voxels: a point and 12 bytes each, drawn at once, and what changes is all that is sent to the graphics unit again.
const many = await page.evaluate(() => {
  const calls = { points: 0, draws: 0, bytes: 0 }, drawArrays = gl.drawArrays.bind(gl), part = gl.bufferSubData.bind(gl), whole = gl.bufferData.bind(gl);
  const later = window.requestAnimationFrame;
  window.requestAnimationFrame = () => 0;  // the page's own frames go on afterwards, once
  gl.drawArrays = (mode, first, n) => { calls.draws += 1; if (mode === gl.POINTS) calls.points += n; drawArrays(mode, first, n); };
  gl.bufferSubData = (...a) => { calls.bytes += a[4]; part(...a); };
  gl.bufferData = (...a) => { if (a[1] === map.bytes) calls.bytes += a[1].length; whole(...a); };
  const bits = new Uint8Array(64).fill(255), colours = new Uint8Array(3 * 512).fill(90), voxels = map.count;
  for (let i = 0; i < 1000; ++i) map.set(1_000_000 + i, [i % 10 + 1000, Math.floor(i / 10) % 10, Math.floor(i / 100)], bits, colours);
  const frame = () => { Object.assign(calls, { points: 0, draws: 0, bytes: 0 }); draw(performance.now()); return { ...calls }; };
  const first = frame();
  map.set(1_000_007, [1007, 0, 0], bits, colours);
  const changed = frame();
  Object.assign(gl, { drawArrays, bufferSubData: part, bufferData: whole });
  window.requestAnimationFrame = later;
  const result = { first, changed, added: map.count - voxels, used: map.used, capacity: map.capacity };
  for (let i = 0; i < 1000; ++i) map.set(1_000_000 + i, [0, 0, 0], bits, colours.subarray(0, 0));
  return result;
});
assert.equal(many.added, 512_000);
assert.deepEqual([many.first.points, many.first.draws, many.first.bytes], [many.used, 2, 12 * many.capacity]);
assert.ok(many.changed.bytes > 0 && many.changed.bytes <= 2 * 4096 * 12, JSON.stringify(many));

// Files: the trajectory, and the last minute as an MCAP file that the format's own reader takes.
const downloaded = async (ending) => {
  await until(`a ${ending} file`, () => readdirSync(folder).some((f) => f.endsWith(ending)));
  return readFileSync(path.join(folder, readdirSync(folder).find((f) => f.endsWith(ending))));
};
await page.click("#trajectory");
const poses = (await downloaded(".txt")).toString().trim().split("\n");
assert.match(poses[0], /^# stamp tx ty tz qx qy qz qw/);
assert.ok(poses.length > 10 && poses.slice(1).every((l) => /^\d+\.\d{9}( -?\d+\.\d{6}){7}$/.test(l)), poses[1]);
await page.click("#minute");
const reader = new McapStreamReader(), topics = new Map(), channels = new Map();
reader.append(await downloaded(".mcap"));
for (let record; (record = reader.nextRecord()); ) {
  if (record.type === "Channel") channels.set(record.id, record.topic);
  if (record.type === "Message") topics.set(channels.get(record.channelId), (topics.get(channels.get(record.channelId)) ?? 0) + 1);
}
assert.ok(reader.done());
for (const topic of ["/pose", "/tf", "/map", "/map/blocks", "/objects", "/camera/color", "/camera/annotations", "/camera/calibration", "/health"])
  assert.ok(topics.get(topic) > 0, `${topic} in ${[...topics]}`);

// The program ends and starts again: the page says so, comes back by itself, and has only the new map.
await stop(program);
await until("the page to notice", async () => (await words(page, "state")) === "offline" && (await page.$eval("#offline", (e) => !e.hidden)));
({ program } = await start(port));
await until("the page to come back", async () => (await words(page, "state")) !== "offline" && (await page.$eval("#offline", (e) => e.hidden)));
await until("the new map", async () => (await number(page, "voxels")) > 1000);
await until("the new map in the picture", async () => (await look(page)).colours > 100);

assert.deepEqual(errors, []);
assert.deepEqual(requests.filter((r) => !/^(http|ws):\/\/127\.0\.0\.1:\d+\/|^(data|blob):/.test(r)), [], "nothing is asked of anyone else");
await browser.close();
await stop(program);
console.log("the viewer draws the map, the boxes and the counters, and comes back after a restart");
process.exit(0);
