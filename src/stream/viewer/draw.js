// SPDX-License-Identifier: Apache-2.0
// Drawing.
const gl = canvas.getContext("webgl2", { antialias: true, powerPreference: "high-performance" });
if (!gl) { $("offline").hidden = false; $("why").textContent = "this browser has no WebGL 2"; }
function program(vertex, fragment) {
  const p = gl.createProgram();
  for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const s = gl.createShader(type);
    gl.shaderSource(s, "#version 300 es\nprecision highp float;\n" + source);
    gl.compileShader(s);
    if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
    gl.attachShader(p, s);
  }
  gl.linkProgram(p);
  const found = {};
  return { use: () => gl.useProgram(p), at: (name) => (found[name] ??= gl.getUniformLocation(p, name)) };
}
// A voxel is one point sprite; its pixels find the cube's face that their ray meets. So 500,000 cubes cost 500,000
// vertices, and faces are shaded though nobody sends normals. The sprite is just as big as the cube: half its extent along
// the view's axes, as seen from there.
const voxels = program(`
layout(location=0) in vec3 cell; layout(location=1) in vec4 rgba;
uniform mat4 m; uniform vec3 half_, up; uniform vec2 slope; uniform float edge, px, roof; out vec3 centre; out vec3 colour; out float size;
void main() {
  centre = (cell + 0.5) * edge; colour = rgba.rgb;
  gl_Position = rgba.a == 0. || dot(centre, up) > roof ? vec4(2, 2, 2, 1) : m * vec4(centre, 1);
  float w = gl_Position.w, near = max(w - half_.z, 0.01);
  vec2 aside = abs(gl_Position.xy) / w * slope, reach = half_.xy + min(aside, 2. * slope) * half_.z;
  size = gl_PointSize = clamp(2. * px * max(reach.x, reach.y) / near, 1.5, 400.);
}`, `
in vec3 centre; in vec3 colour; in float size; out vec4 pixel;
uniform vec3 eye, forward, right, above, up; uniform vec2 perPixel, depth; uniform float edge;
void main() {
  float light = 0.9;
  gl_FragDepth = gl_FragCoord.z;
  float z = distance(eye, centre);
  if (size > 3.) {
    vec2 at = gl_FragCoord.xy * perPixel - 1.;
    vec3 ray = forward + at.x * right + at.y * above, o = eye - centre, inv = 1. / ray, h = vec3(0.5 * edge);
    vec3 a = (-h - o) * inv, b = (h - o) * inv, near = min(a, b), far = max(a, b);
    z = max(max(near.x, near.y), near.z);
    if (z > min(min(far.x, far.y), far.z) || z < 0.) discard;
    vec3 normal = -sign(ray) * step(vec3(z), near);
    light = 0.86 + 0.2 * dot(normal, up) - 0.07 * abs(dot(normal, vec3(up.y, up.z, up.x)));
    gl_FragDepth = 0.5 * (depth.x - depth.y / z) + 0.5;
  }
  float haze = exp(-0.018 * z);
  pixel = vec4(mix(vec3(0.075, 0.095, 0.12), pow(colour, vec3(0.88)) * light, haze), 1);
}`);
// A line is a ribbon of some pixels' width.
const lines = program(`
layout(location=0) in vec3 a; layout(location=1) in vec3 b; layout(location=2) in vec4 rgba;
uniform mat4 m; uniform vec2 size; uniform float width; out vec4 colour;
void main() {
  colour = rgba;
  vec4 p = m * vec4(a, 1), q = m * vec4(b, 1);
  if (p.w < 0.02 && q.w < 0.02) { gl_Position = vec4(2, 2, 2, 1); return; }
  if (p.w < 0.02) p = mix(q, p, (q.w - 0.02) / (q.w - p.w));
  if (q.w < 0.02) q = mix(p, q, (p.w - 0.02) / (p.w - q.w));
  vec4 end = gl_VertexID < 2 ? p : q;
  vec2 along = (q.xy / q.w - p.xy / p.w) * size, side = normalize(vec2(-along.y, along.x) + 1e-6);
  gl_Position = end + vec4(side * (gl_VertexID % 2 == 0 ? 1. : -1.) * width / size * end.w, 0, 0);
}`, `in vec4 colour; out vec4 pixel; void main() { pixel = colour; }`);
const faces = program(`layout(location=0) in vec3 p; layout(location=1) in vec4 rgba; uniform mat4 m; out vec4 colour;
void main() { colour = rgba; gl_Position = m * vec4(p, 1); }`, `in vec4 colour; out vec4 pixel; void main() { pixel = colour; }`);
function vertexArray(attributes, stride, divisor) {
  const array = gl.createVertexArray(), buffer = gl.createBuffer();
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  attributes.forEach(([count, type, normalized, offset], i) => {
    gl.enableVertexAttribArray(i);
    gl.vertexAttribPointer(i, count, type, normalized, stride, offset);
    gl.vertexAttribDivisor(i, divisor);
  });
  return { array, buffer };
}
const voxelArray = vertexArray([[3, gl.SHORT, false, 0], [4, gl.UNSIGNED_BYTE, true, 8]], kVoxelBytes, 0);
const lineArray = vertexArray([[3, gl.FLOAT, false, 0], [3, gl.FLOAT, false, 12], [4, gl.FLOAT, false, 24]], 40, 1);
const faceArray = vertexArray([[3, gl.FLOAT, false, 0], [4, gl.FLOAT, false, 12]], 28, 0);
const upload = (of, data, use) => { gl.bindBuffer(gl.ARRAY_BUFFER, of.buffer); gl.bufferData(gl.ARRAY_BUFFER, data, use); };

function uploadMap() {
  gl.bindBuffer(gl.ARRAY_BUFFER, voxelArray.buffer);
  if (map.grown) gl.bufferData(gl.ARRAY_BUFFER, map.bytes, gl.DYNAMIC_DRAW);
  else for (const page of map.dirty) {
    const begin = page * kPage * kVoxelBytes;
    gl.bufferSubData(gl.ARRAY_BUFFER, begin, map.bytes, begin, Math.min(kPage * kVoxelBytes, map.bytes.length - begin));
  }
  map.grown = false;
  map.dirty.clear();
}

const kCyan = [0.3, 0.76, 1, 1], kCorners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => [(i & 1) - 0.5, (i >> 1 & 1) - 0.5, (i >> 2) - 0.5]);
const kEdges = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
const kFaces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
function sceneGeometry(now) {
  const segments = [], triangles = [], labels = [];
  const line = (a, b, c) => segments.push(a[0], a[1], a[2], b[0], b[1], b[2], ...c);
  if (shown.path) for (let i = 1; i < path.length; ++i) if (!path[i].begins) line(path[i - 1], path[i], [0.3, 0.76, 1, 0.35 + 0.65 * i / path.length]);
  if (camera) {
    const K = calibration?.K, d = 0.22, sx = K ? calibration.width / 2 / K[0] : 0.6, sy = K ? calibration.height / 2 / K[4] : 0.45;
    const corner = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => place(camera, [x * sx * d, y * sy * d, d]));
    if (path.length) line(path.at(-1), camera.p, kCyan);
    corner.forEach((c, i) => { line(camera.p, c, kCyan); line(c, corner[(i + 1) % 4], kCyan);
      for (const p of [camera.p, c, corner[(i + 1) % 4]]) triangles.push(p[0], p[1], p[2], 0.3, 0.76, 1, 0.16); });
  }
  for (const [id, o] of objects) {
    if (now - o.seen > kForgotten_ms) { objects.delete(id); continue; }
    if (!shown.objects || !o.cube) continue;
    const T = o.cube.pose, s = o.cube.size, c = o.cube.color;
    const corners = kCorners.map((k) => place(T, [k[0] * s[0], k[1] * s[1], k[2] * s[2]]));
    const moves = o.meta?.some((m) => m.key === "kind" && m.value === "dynamic");
    for (const [i, j] of kEdges) line(corners[i], corners[j], [c[0], c[1], c[2], moves ? 0.95 : 0.5]);
    for (const [i, j, k, l] of kFaces) for (const p of [i, j, k, i, k, l]) triangles.push(...corners[p], c[0], c[1], c[2], moves ? 0.09 : 0.03);
    if (o.arrow) {
      const tip = o.arrow.shaft + o.arrow.head, from = [[0, 0, 0], [tip - 0.12, 0.06, 0], [tip - 0.12, -0.06, 0]];
      for (const at of from) line(place(o.arrow.pose, at), place(o.arrow.pose, [tip, 0, 0]), [1, 1, 1, 0.9]);
    }
    labels.push({ at: place(T, [0, -0.5 * s[1] - 0.06, 0]), words: o.text ?? "", moves });
  }
  return { segments: new Float32Array(segments), triangles: new Float32Array(triangles), labels };
}
function placeLabels(labels, m, width, height) {
  const box = $("labels");
  while (box.children.length < labels.length) box.appendChild(Object.assign(document.createElement("div"), { className: "label" }));
  const depth = ([x, y, z]) => m[3] * x + m[7] * y + m[11] * z + m[15], placed = [];
  labels.sort((a, b) => depth(a.at) - depth(b.at));
  [...box.children].forEach((div, i) => {
    const l = labels[i], [x, y, z] = l?.at ?? [0, 0, 0], w = l ? depth(l.at) : 0;
    div.hidden = !(w > 0.05);
    if (div.hidden) return;
    const sx = ((m[0] * x + m[4] * y + m[8] * z + m[12]) / w + 1) / 2 * width;
    let sy = (1 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / w) / 2 * height;
    div.textContent = l.words;
    div.style.opacity = l.moves ? 1 : 0.55;
    // The nearest stay where they are; one that would lie on another goes above it.
    const half = div.offsetWidth / 2, tall = div.offsetHeight + 2;
    for (const p of placed) if (Math.abs(p.x - sx) < p.half + half && Math.abs(p.y - sy) < tall) sy = p.y - tall;
    placed.push({ x: sx, y: sy, half });
    placed.sort((a, b) => b.y - a.y);
    div.style.transform = `translate(${sx.toFixed(1)}px, ${sy.toFixed(1)}px) translate(-50%, -100%)`;
  });
}

// Drawn pixels per pixel of the page: fewer where the graphics unit cannot keep up, more again where it has room for them.
let finest = 2;
function adaptPixels(fps) {
  if (!document.hidden && fps < 24) finest = Math.max(1, finest / 1.4);
  if (fps > 50) finest = Math.min(2, finest * 1.4);
}
// Who looks from above sees into the room: what is this much higher than the camera is left out then.
const kRoof_m = 0.4;
function roofOf(eye, u) {
  const roof = camera ? dot(camera.p, u) + kRoof_m : Infinity;
  return dot(eye, u) > roof ? roof : 1e9;
}
const kNear = 0.05, kFar = 200, kHalfHeight = Math.tan(0.5);
function draw(now) {
  requestAnimationFrame(draw);
  const ratio = Math.min(devicePixelRatio || 1, finest), width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  if (view.follow && camera) view.target = add(view.target, add(add(camera.p, rotate(camera.q, [0, 0, 1]), 1.2), view.target, -1), 0.06);
  const eye = eyeOf(), u = basis()[0], forward = unit(add(view.target, eye, -1)), right = unit(cross(forward, u)), above = cross(right, forward);
  const aspect = width / height, A = (kFar + kNear) / (kFar - kNear), B = 2 * kFar * kNear / (kFar - kNear);
  const look = [right[0], above[0], -forward[0], 0, right[1], above[1], -forward[1], 0, right[2], above[2], -forward[2], 0, -dot(right, eye), -dot(above, eye), dot(forward, eye), 1];
  const m = times([1 / (kHalfHeight * aspect), 0, 0, 0, 0, 1 / kHalfHeight, 0, 0, 0, 0, -A, -1, 0, 0, -B, 0], look);
  gl.viewport(0, 0, width, height);
  gl.clearColor(0.063, 0.078, 0.102, 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(gl.LEQUAL);

  if (map.grown || map.dirty.size) uploadMap();
  gl.disable(gl.BLEND);
  voxels.use();
  gl.uniformMatrix4fv(voxels.at("m"), false, m);
  gl.uniform1f(voxels.at("edge"), map.voxel_m);
  gl.uniform1f(voxels.at("px"), 0.5 * height / kHalfHeight);
  gl.uniform3fv(voxels.at("half_"), [right, above, forward].map((v) => 0.5 * map.voxel_m * (Math.abs(v[0]) + Math.abs(v[1]) + Math.abs(v[2]))));
  gl.uniform2f(voxels.at("slope"), kHalfHeight * aspect, kHalfHeight);
  gl.uniform3fv(voxels.at("eye"), eye);
  gl.uniform3fv(voxels.at("forward"), forward);
  gl.uniform3fv(voxels.at("right"), right.map((v) => v * kHalfHeight * aspect));
  gl.uniform3fv(voxels.at("above"), above.map((v) => v * kHalfHeight));
  gl.uniform3fv(voxels.at("up"), u);
  gl.uniform1f(voxels.at("roof"), roofOf(eye, u));
  gl.uniform2f(voxels.at("perPixel"), 2 / width, 2 / height);
  gl.uniform2f(voxels.at("depth"), A, B);
  gl.bindVertexArray(voxelArray.array);
  gl.drawArrays(gl.POINTS, 0, map.used);

  const { segments, triangles, labels } = sceneGeometry(performance.now());
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  lines.use();
  gl.uniformMatrix4fv(lines.at("m"), false, m);
  gl.uniform2f(lines.at("size"), width, height);
  gl.uniform1f(lines.at("width"), 2 * ratio);
  upload(lineArray, segments, gl.STREAM_DRAW);
  gl.bindVertexArray(lineArray.array);
  gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, segments.length / 10);
  gl.depthMask(false);
  faces.use();
  gl.uniformMatrix4fv(faces.at("m"), false, m);
  upload(faceArray, triangles, gl.STREAM_DRAW);
  gl.bindVertexArray(faceArray.array);
  gl.drawArrays(gl.TRIANGLES, 0, triangles.length / 7);
  gl.depthMask(true);

  placeLabels(labels, m, canvas.clientWidth, canvas.clientHeight);
  if (picture.changed && shown.preview) { picture.changed = false; drawPicture(); }
  ++framesDrawn;
}
