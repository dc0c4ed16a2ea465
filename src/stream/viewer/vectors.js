// SPDX-License-Identifier: Apache-2.0
// Small vectors. Matrices are columns, as WebGL wants them.
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a.slice(0, 3)) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };
function rotate([x, y, z, w], v) {
  const t = cross([x, y, z], v).map((c) => 2 * c), u = cross([x, y, z], t);
  return [v[0] + w * t[0] + u[0], v[1] + w * t[1] + u[1], v[2] + w * t[2] + u[2]];
}
const place = (T, v) => add(rotate(T.q, v), T.p);
function times(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; ++c) for (let r = 0; r < 4; ++r) for (let k = 0; k < 4; ++k) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}
