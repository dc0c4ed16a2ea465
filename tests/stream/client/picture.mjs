// SPDX-License-Identifier: Apache-2.0
// node picture.mjs ADDRESS FILE [WIDTHxHEIGHT]: a picture of the built-in page, once the program there has seen much of a room and
// somebody walks in view. The README's is of a lap around the demo's room: stillmap-synth --seed 3 --people 3 --path walk --frames 420.
import { spawnSync } from "node:child_process";

import puppeteer from "puppeteer-core";

const [, , address, file, size = "1280x800"] = process.argv, [width, height] = size.split("x").map(Number);
const browser = await puppeteer.launch({
  executablePath: spawnSync("sh", ["-c", "command -v chromium || command -v google-chrome"]).stdout.toString().trim(), timeout: 0, protocolTimeout: 0,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"] });
const page = await browser.newPage();
await page.setViewport({ width, height });
await page.goto(address, { timeout: 0 });
const until = (condition) => page.waitForFunction(condition, { timeout: 0, polling: 50 });
await until(() => health?.keyframes > 75 && map.count > 100_000);
await page.evaluate(() => {
  Object.assign(view, { pitch: 0.55, distance: 1.25 * view.distance });
  // That a browser without a graphics unit draws slowly and takes time from the program says nothing about others.
  $("drawn").parentElement.style.display = $("log").style.display = "none";
});
await until(() => [...objects.values()].filter((o) => o.arrow && performance.now() - o.seen < 600).length > 0 && objects.size < 4);
await page.screenshot({ path: file });
await browser.close();
