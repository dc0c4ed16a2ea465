// SPDX-License-Identifier: Apache-2.0
// Protobuf: just enough to read what the server sends.
class Reader {
  constructor(bytes) { this.b = bytes; this.i = 0; this.end = bytes.length; this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length); }
  varint() {
    let value = 0, scale = 1;
    for (;;) { const byte = this.b[this.i++]; value += (byte & 127) * scale; if (byte < 128) return value; scale *= 128; }
  }
  /// Calls on(number, value): numbers as numbers, bytes and messages as Uint8Array.
  each(on) {
    while (this.i < this.end) {
      const key = this.varint(), type = key & 7;
      let value;
      if (type === 0) value = this.varint();
      else if (type === 1) { value = this.view.getFloat64(this.i, true); this.i += 8; }
      else if (type === 5) { value = this.view.getUint32(this.i, true); this.i += 4; }
      else { const n = this.varint(); value = this.b.subarray(this.i, this.i + n); this.i += n; }
      on(key >>> 3, value);
    }
  }
}
const utf8 = new TextDecoder();
const zigzag = (v) => (v % 2 ? -(v + 1) / 2 : v / 2);
/// A message as an object: `names` maps field numbers to names, or to [name, read] for others than numbers.
function read(bytes, names) {
  const out = {};
  new Reader(bytes).each((n, v) => {
    const name = names[n];
    if (!name) return;
    if (typeof name === "string") out[name] = v;
    else if (name[2]) (out[name[0]] ??= []).push(name[1](v));
    else out[name[0]] = name[1](v);
  });
  return out;
}
const text = (b) => utf8.decode(b);
const doubles = (b) => Array.from({ length: b.length / 8 }, (_, i) => new DataView(b.buffer, b.byteOffset).getFloat64(8 * i, true));
const xyzw = (b) => { const v = read(b, { 1: "x", 2: "y", 3: "z", 4: "w" }); return [v.x ?? 0, v.y ?? 0, v.z ?? 0, v.w ?? 0]; };
const pose = (b) => ({ p: [0, 0, 0, 0], q: [0, 0, 0, 1], ...read(b, { 1: ["p", xyzw], 2: ["q", xyzw] }) });
const pair = (b) => read(b, { 1: ["key", text], 2: ["value", text] });
const cube = (b) => read(b, { 1: ["pose", pose], 2: ["size", xyzw], 3: ["color", xyzw] });
const arrow = (b) => read(b, { 1: ["pose", pose], 2: "shaft", 4: "head" });
const entity = (b) => read(b, { 3: ["id", text], 6: ["meta", pair, true], 7: ["arrow", arrow], 8: ["cube", cube],
  13: ["text", (t) => read(t, { 6: ["text", text] }).text] });
const point2 = (b) => { const v = new DataView(b.buffer, b.byteOffset, b.length); let x = 0, y = 0;
  for (let i = 0; i < b.length; i += 9) b[i] === 9 ? (x = v.getFloat64(i + 1, true)) : (y = v.getFloat64(i + 1, true));
  return [x, y]; };
const pointsAnnotation = (b) => read(b, { 2: "type", 3: ["points", point2, true], 4: ["color", xyzw], 7: "thickness" });
const textAnnotation = (b) => read(b, { 2: ["at", point2], 3: ["text", text], 6: ["back", xyzw] });
