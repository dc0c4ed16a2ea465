// SPDX-License-Identifier: Apache-2.0
// What else is known.
let path, poses, camera, objects, calibration, health, up, session = "";
function forget() {
  map.clear();
  path = []; poses = []; camera = null; objects = new Map(); calibration = null; health = null; up = null;
  view.aimed = false;
}
function takePose(data, stamp) {
  const T = read(data, { 3: ["pose", pose] }).pose;
  camera = T;
  if (poses.length < 500_000) poses.push([stamp, T]);
  const last = path.at(-1);
  if (!last || Math.hypot(...add(T.p, last, -1)) > 0.02) path.push(T.p.slice(0, 3));
  if (path.length > 20_000) path = path.filter((_, i) => i % 2 === 0 || i === path.length - 1);
  if (!up) {  // the map's axis that is nearest to the camera's own up
    const y = rotate(T.q, [0, -1, 0]), k = [0, 1, 2].reduce((a, b) => (Math.abs(y[b]) > Math.abs(y[a]) ? b : a));
    up = [0, 0, 0]; up[k] = Math.sign(y[k]);
  }
  if (!view.aimed) aim();
}
function takeObjects(data) {
  for (const e of read(data, { 2: ["entities", entity, true] }).entities ?? []) objects.set(e.id, { ...e, seen: performance.now() });
}
