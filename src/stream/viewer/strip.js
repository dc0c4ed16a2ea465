// SPDX-License-Identifier: Apache-2.0
// The strip. A figure that is worse than its first limit is amber, than its second red.
const grade = (id, words, value, warn, bad) => {
  $(id).textContent = words;
  $(id).className = value >= bad ? "bad" : value >= warn ? "warn" : "";
};
function takeHealth(data) {
  const before = health;
  health = read(data, { 2: ["state", text], 4: "fps", 5: "latency", 6: "offered", 8: "dropped", 10: "keyframes", 12: "rss" });
  $("state").className = $("state").textContent = health.state || "offline";
  $("fps").textContent = (health.fps ?? 0).toFixed(1);
  grade("latency", health.latency ? `${health.latency.toFixed(1)} ms` : "–", health.latency ?? 0, 33, 100);
  const since = (key) => (health[key] ?? 0) - (before?.[key] ?? 0);
  grade("drops", `${health.dropped ?? 0}`, since("dropped") / Math.max(since("offered"), 1), 0.01, 0.1);
  $("memory").textContent = `${((health.rss ?? 0) / 1e6).toFixed(0)} MB`;
  $("keyframes").textContent = health.keyframes ?? 0;
}
let logTimer;
function takeLog(data) {
  const m = read(data, { 2: "level", 3: ["text", text], 4: ["name", text] });
  $("log").textContent = `${m.name}: ${m.text}`;
  $("log").className = m.level >= 3 ? "card warn" : "card";
  $("log").style.opacity = 1;
  clearTimeout(logTimer);
  logTimer = setTimeout(() => ($("log").style.opacity = 0), 5000);
}
let framesDrawn = 0;
setInterval(() => {
  $("link").textContent = `${(link.bytes / 1000).toFixed(0)} kB/s`;
  grade("drawn", `${framesDrawn} fps`, -framesDrawn, -24, -10);
  adaptPixels(framesDrawn);
  $("movers").textContent = [...objects.values()].filter((o) => performance.now() - o.seen < kForgotten_ms && o.meta?.some((m) => m.value === "dynamic")).length;
  $("voxels").textContent = map.count.toLocaleString("en");
  link.bytes = framesDrawn = 0;
}, 1000);
