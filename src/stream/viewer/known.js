// SPDX-License-Identifier: Apache-2.0
// What else is known.
let path, poses, epoch, camera, objects, calibration, health, up, session = "";
function forget() {
  map.clear();
  path = []; poses = []; epoch = 0; camera = null; objects = new Map(); calibration = null; health = null; up = null;
  view.aimed = false;
}
function takePose(data, stamp) {
  const m = read(data, { 3: ["pose", pose], 1000: "epoch" }), T = m.pose, corrected = (m.epoch ?? 0) !== epoch;
  camera = T;
  epoch = m.epoch ?? 0;
  if (poses.length < 500_000) poses.push([stamp, T]);
  const last = path.at(-1);
  // A correction moves the map, not the camera: no line leads from where it was thought to be.
  if (!last || corrected || Math.hypot(...add(T.p, last, -1)) > 0.02) path.push(Object.assign(T.p.slice(0, 3), { begins: corrected }));
  if (path.length > 20_000) path = path.filter((p, i) => i % 2 === 0 || p.begins || i === path.length - 1);
  if (!up) {  // the map's axis that is nearest to the camera's own up
    const y = rotate(T.q, [0, -1, 0]), k = [0, 1, 2].reduce((a, b) => (Math.abs(y[b]) > Math.abs(y[a]) ? b : a));
    up = [0, 0, 0]; up[k] = Math.sign(y[k]);
  }
  if (!view.aimed) aim();
}
const kForgotten_ms = 600;  // an object that was not told of for so long is gone
function takeObjects(data) {
  for (const e of read(data, { 2: ["entities", entity, true] }).entities ?? []) objects.set(e.id, { ...e, seen: performance.now() });
}
