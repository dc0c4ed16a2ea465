// SPDX-License-Identifier: Apache-2.0
// The last minute, as it came.
const recorded = { items: [], bytes: 0, calibration: [] };
function record(channel, stamp, data) {
  const now = performance.now(), items = recorded.items;
  // Sent once, and needed for all that follows.
  if (link.channels.get(channel)?.topic === "/camera/calibration") { recorded.calibration = [{ channel, stamp, data }]; return; }
  items.push({ channel, stamp, data, now });
  recorded.bytes += data.length;
  let old = 0;
  while (old < items.length && (now - items[old].now > 60_000 || recorded.bytes > 128e6)) recorded.bytes -= items[old++].data.length;
  if (old) items.splice(0, old);
}
/// The format of mcap.dev/spec, without chunks or index, which readers can do without.
function mcap(items, channels) {
  const parts = [], encode = (s) => new TextEncoder().encode(s);
  const u = (bytes, value) => { const v = new DataView(new ArrayBuffer(bytes));
    bytes === 8 ? v.setBigUint64(0, BigInt(value), true) : bytes === 4 ? v.setUint32(0, value, true) : v.setUint16(0, value, true);
    return new Uint8Array(v.buffer); };
  const string = (s) => [u(4, encode(s).length), encode(s)];
  const put = (op, ...fields) => { const content = fields.flat(); parts.push(new Uint8Array([op]), u(8, content.reduce((n, f) => n + f.length, 0)), ...content); };
  const magic = new Uint8Array([0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a]);
  parts.push(magic);
  put(1, string(""), string("stillmap viewer"));
  for (const c of channels) {
    const schema = Uint8Array.from(atob(c.schema), (x) => x.charCodeAt(0));
    put(3, u(2, c.id), string(c.schemaName), string(c.schemaEncoding), u(4, schema.length), schema);
    put(4, u(2, c.id), u(2, c.id), string(c.topic), string(c.encoding), u(4, 0));
  }
  items.forEach((m, i) => put(5, u(2, m.channel), u(4, i), u(8, m.stamp), u(8, m.stamp), m.data));
  put(15, u(4, 0));
  put(2, u(8, 0), u(8, 0), u(4, 0));
  parts.push(magic);
  return parts;
}
function save(name, parts) {
  const a = document.createElement("a");
  a.href = URL.createObjectURL(new Blob(parts));
  a.download = name;
  a.click();
  setTimeout(() => URL.revokeObjectURL(a.href), 60_000);
}
const fileTime = () => new Date().toISOString().slice(0, 19).replaceAll(":", "");
$("trajectory").onclick = () => {
  const seconds = (t) => `${t / 1_000_000_000n}.${String(t % 1_000_000_000n).padStart(9, "0")}`;
  save(`stillmap-${fileTime()}.txt`, ["# stamp tx ty tz qx qy qz qw: T_map_camera\n",
    ...poses.map(([t, { p, q }]) => [seconds(t), ...[...p.slice(0, 3), ...q].map((v) => v.toFixed(6))].join(" ") + "\n")]);
};
$("minute").onclick = () => {  // with the whole map, which what changed in a minute is not
  const done = () => { link.onCloud = null; link.unsubscribe("/map"); save(`stillmap-${fileTime()}.mcap`, mcap([...recorded.calibration, ...recorded.items], [...link.channels.values()])); };
  const timer = setTimeout(done, 5000);
  link.onCloud = () => { clearTimeout(timer); done(); };
  link.subscribe("/map");
};
