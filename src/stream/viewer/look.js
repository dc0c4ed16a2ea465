// SPDX-License-Identifier: Apache-2.0
// Looking around: an orbit around a point, which follows the camera unless it is let go.
const canvas = $("view"), shown = { path: true, objects: true, preview: true };
const view = { target: [0, 0, 0], yaw: 0, pitch: 0.5, distance: 3.5, follow: true, aimed: false };
function basis() {
  const u = up ?? [0, 0, 1], a = Math.abs(u[0]) > 0.5 ? [0, 1, 0] : [1, 0, 0], e = unit(cross(u, a));
  return [u, e, cross(u, e)];
}
function aim() {  // from behind the camera and a little above it
  const [u, e, f] = basis(), forward = camera ? rotate(camera.q, [0, 0, 1]) : [1, 0, 0];
  view.yaw = Math.atan2(-dot(forward, f), -dot(forward, e));
  // On a phone that is held upright, from farther away: as much is to be seen from left to right.
  const narrow = Math.max(1, canvas.clientHeight / canvas.clientWidth);
  Object.assign(view, { pitch: 0.5, distance: 3.5 * narrow ** 0.75, aimed: camera !== null });
  view.target = camera ? add(camera.p, forward, 1.2) : [0, 0, 0];
}
function eyeOf() {
  const [u, e, f] = basis(), c = Math.cos(view.pitch);
  return add(add(add(view.target, e, view.distance * c * Math.cos(view.yaw)), f, view.distance * c * Math.sin(view.yaw)), u, view.distance * Math.sin(view.pitch));
}
function setFollow(on) { view.follow = on; $("follow").classList.toggle("on", on); }
const fingers = new Map();
canvas.onpointerdown = (e) => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, e); };
canvas.onpointerup = canvas.onpointercancel = (e) => fingers.delete(e.pointerId);
canvas.oncontextmenu = (e) => e.preventDefault();
canvas.onpointermove = (e) => {
  const before = fingers.get(e.pointerId);
  if (!before) return;
  const other = [...fingers.values()].find((f) => f.pointerId !== e.pointerId);
  const dx = e.clientX - before.clientX, dy = e.clientY - before.clientY;
  if (other) {
    const span = (f) => Math.hypot(f.clientX - other.clientX, f.clientY - other.clientY) || 1;
    zoom(span(before) / span(e));
    pan(dx / 2, dy / 2);
  } else if (e.buttons & 2 || e.shiftKey) pan(dx, dy);
  else { view.yaw -= 0.006 * dx; view.pitch = Math.max(-1.5, Math.min(1.5, view.pitch + 0.006 * dy)); }
  fingers.set(e.pointerId, e);
};
canvas.onwheel = (e) => { e.preventDefault(); zoom(Math.exp(0.0012 * e.deltaY)); };
function zoom(by) { view.distance = Math.max(0.3, Math.min(80, view.distance * by)); }
function pan(dx, dy) {
  const forward = unit(add(view.target, eyeOf(), -1)), right = unit(cross(forward, basis()[0])), above = cross(right, forward);
  const s = 1.2 * view.distance / canvas.clientHeight;
  view.target = add(add(view.target, right, -s * dx), above, s * dy);
  setFollow(false);
}
$("follow").onclick = () => setFollow(!view.follow);
$("reset").onclick = () => { aim(); setFollow(true); };
for (const name of ["path", "objects", "preview"]) $(`${name}Button`).onclick = (e) => {
  shown[name] = !shown[name];
  e.target.classList.toggle("on", shown[name]);
  if (name !== "preview") return;
  $("preview").style.display = shown.preview ? "" : "none";
  link[shown.preview ? "subscribe" : "unsubscribe"]("/camera/color");
};
