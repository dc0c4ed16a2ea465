// SPDX-License-Identifier: Apache-2.0
// Preview: a picture, and the annotations of the same stamp.
const picture = { bitmap: null, stamp: "", annotations: new Map(), changed: false };
async function takePicture(data, stamp) {
  const jpeg = read(data, { 2: ["data", (b) => b] }).data;
  const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
  picture.bitmap?.close();
  Object.assign(picture, { bitmap, stamp: String(stamp), changed: true });
}
function takeAnnotations(data, stamp) {
  picture.annotations.set(String(stamp), read(data, { 2: ["points", pointsAnnotation, true], 3: ["texts", textAnnotation, true] }));
  if (picture.annotations.size > 20) picture.annotations.delete(picture.annotations.keys().next().value);
  picture.changed = true;
}
const css = (c) => `rgba(${c[0] * 255 | 0},${c[1] * 255 | 0},${c[2] * 255 | 0},${c[3] || 1})`;
function drawPicture() {
  const canvas = $("picture"), g = canvas.getContext("2d"), width = calibration?.width ?? 320, height = calibration?.height ?? 240;
  const scale = 2;  // the overlay is drawn finer than the picture
  if (canvas.width !== scale * width || canvas.height !== scale * height) { canvas.width = scale * width; canvas.height = scale * height; }
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.fillStyle = "#06080b"; g.fillRect(0, 0, width, height);
  if (picture.bitmap) g.drawImage(picture.bitmap, 0, 0, width, height);
  else { g.fillStyle = "#667"; g.font = "12px system-ui"; g.textAlign = "center"; g.fillText("no picture: only those whose people are known leave the robot", width / 2, height - 10, width - 10); g.textAlign = "left"; }
  const a = picture.annotations.get(picture.stamp) ?? [...picture.annotations.values()].at(-1);
  g.translate(0.5, 0.5);
  for (const { type, points = [], color, thickness } of a?.points ?? []) {
    g.fillStyle = g.strokeStyle = css(color);
    if (type === 1) { for (const [x, y] of points) g.fillRect(x - 1, y - 1, 2, 2); continue; }
    g.lineWidth = thickness; g.beginPath();
    for (const [x, y] of points) g.lineTo(x, y);
    g.closePath(); g.stroke();
  }
  g.font = "600 10px system-ui";
  for (const { at, text: words, back } of a?.texts ?? []) {
    const w = g.measureText(words).width + 6, x = Math.max(0, Math.min(at[0], width - w)), y = Math.max(12, at[1]);
    g.fillStyle = css(back); g.fillRect(x, y - 12, w, 12);
    g.fillStyle = "#fff"; g.fillText(words, x + 3, y - 3);
  }
}
