// SPDX-License-Identifier: Apache-2.0
// node epoch_test.mjs STILLMAP: the official client looks on while a correction mends the map, and holds poses, map and
// cloud against each other. The log is a real walk, cut: the camera is carried off unseen, so that a second segment
// begins, and walks back to where it was, which joins the two.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { setTimeout as sleep } from "node:timers/promises";

import wsProtocol from "@foxglove/ws-protocol";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor.js";
import WebSocket from "ws";

const source = process.env.STILLMAP_SOURCE_DIR, shared = process.env.STILLMAP_SHARED ?? path.join(source, "..", "shared");
const walk = path.join(shared, "data/office_walk");
if (!existsSync(walk)) {
  console.log("skipped: needs the shared data folder (STILLMAP_SHARED)");
  process.exit(77);
}
const folder = mkdtempSync(path.join(tmpdir(), "stillmap-epoch-"));
process.on("exit", () => rmSync(folder, { recursive: true, force: true }));

const kLeft = 25, kFrom = 70, kTo = 85;  // frames of the walk: seen until, next seen from, back again from
function makeLog() {
  const range = (from, to) => Array.from({ length: Math.abs(to - from) }, (_, i) => from + i * Math.sign(to - from));
  const lines = readFileSync(path.join(walk, "associations.txt"), "utf8").split("\n").filter((l) => l && l[0] !== "#").map((l) => l.split(/\s+/));
  const there_and_back = [...range(0, kLeft), ...range(kLeft, 0)];
  const order = [...range(0, kLeft), ...range(kFrom, kTo), ...range(kTo, 0), ...Array(100).fill(there_and_back).flat()];
  for (const kind of ["rgb", "depth"]) symlinkSync(path.join(walk, kind), path.join(folder, kind));
  writeFileSync(path.join(folder, "associations.txt"), order.map((k, i) => {
    const t = (1 + i / 5).toFixed(6);
    return `${t} ${lines[k][1]} ${t} ${lines[k][3]}\n`;
  }).join(""));
}
makeLog();

async function until(what, program, condition) {
  for (const end = Date.now() + 240_000; Date.now() < end; await sleep(10)) {
    if (condition()) return;
    assert.equal(program.exitCode, null, `the program ended before ${what}`);
  }
  assert.fail(`waited for ${what}`);
}

/// Starts the program and keeps what its stream tells, until `enough`.
async function look(enough) {
  const program = spawn(process.argv[2], ["run", "--config", path.join(source, "firmware-config/cameras/hololens-540x360.toml"),
    "--set", "detector.model=none", "--source", `tum:${folder}`, "--mode", "lockstep", "--listen", "127.0.0.1:0"],
    { stdio: ["ignore", "ignore", "pipe"] });
  process.on("exit", () => program.kill("SIGKILL"));
  let words = "";
  program.stderr.on("data", (text) => (words += text));
  await until("it listens", program, () => /http:\/\/127\.0\.0\.1:\d+ /.test(words));
  const socket = new WebSocket(`ws://127.0.0.1:${/127\.0\.0\.1:(\d+) /.exec(words)[1]}`, ["foxglove.websocket.v1"]);
  const client = new wsProtocol.FoxgloveClient({ ws: socket }), topics = new Map();
  const seen = { poses: [], chains: new Map(), clouds: [], slots: new Map(), maps: [] };
  const take = {
    "/pose": (m, stamp) => seen.poses.push({ stamp, epoch: m.epoch, pose: m.pose }),
    "/tf": (m, stamp) => seen.chains.set(stamp, { epoch: m.epoch, transforms: m.transforms }),
    "/map": (m) => seen.clouds.push({ epoch: m.epoch, points: m.data.slice() }),
    // The map as it was, or newer, each time that a pass is complete.
    "/map/blocks": (m, stamp) => {
      for (const b of m.blocks) b.occupied.length ? seen.slots.set(b.slot, b) : seen.slots.delete(b.slot);
      if (m.complete) seen.maps.push({ epoch: m.epoch, stamp, voxel_m: m.voxelM, blocks: [...seen.slots.values()] });
    },
  };
  client.on("advertise", (channels) => {
    for (const c of channels) {
      if (!take[c.topic]) continue;
      const type = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(Buffer.from(c.schema, "base64"))).lookupType(c.schemaName);
      topics.set(client.subscribe(c.id), [take[c.topic], type]);
    }
  });
  client.on("message", ({ subscriptionId, timestamp, data }) => {
    const [to, type] = topics.get(subscriptionId);
    to(type.decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength)), timestamp);
  });
  await until("a pose", program, () => seen.poses.length > 0);
  if (seen.poses[0].epoch === 0) await until("the correction, and the map after it", program, () => enough(seen));
  client.close();
  const ended = new Promise((resolve) => program.once("exit", resolve));
  program.kill("SIGINT");
  await ended;
  return seen;
}

const enough = (seen) => seen.clouds.at(-1)?.epoch > 0 && seen.maps.filter((m) => m.epoch > 0).length > 1 && seen.poses.at(-1).epoch > 0;
let seen = await look(enough);
// On a machine with much else to do, a client may come when all is over.
for (let again = 0; again < 5 && seen.poses[0].epoch > 0; ++again) seen = await look(enough);

// Poses and transforms are of one epoch each, which only grows; map -> odom changes with it and at no other time.
const rotate = (q, [x, y, z]) => {
  const t = [2 * (q.y * z - q.z * y), 2 * (q.z * x - q.x * z), 2 * (q.x * y - q.y * x)];
  return [x + q.w * t[0] + q.y * t[2] - q.z * t[1], y + q.w * t[1] + q.z * t[0] - q.x * t[2], z + q.w * t[2] + q.x * t[1] - q.y * t[0]];
};
const vector = (v) => [v.x, v.y, v.z], distance = (a, b) => Math.hypot(...a.map((v, i) => v - b[i]));
const apply = (T, p) => rotate(T.rotation, p).map((v, i) => v + vector(T.translation)[i]);
const unapply = (T, p) => rotate({ x: T.rotation.x, y: T.rotation.y, z: T.rotation.z, w: -T.rotation.w }, p.map((v, i) => v - vector(T.translation)[i]));
let before = null;
const maps_to_odom = new Map();
for (const { stamp, epoch, pose } of seen.poses) {
  const chain = seen.chains.get(stamp);
  if (!chain) continue;  // dropped for a slow client
  assert.equal(chain.epoch, epoch);
  const [odom, base, camera] = chain.transforms;
  assert.ok(distance(apply(odom, apply(base, vector(camera.translation))), vector(pose.position)) < 1e-6);
  if (before) assert.ok(epoch >= before.epoch);
  if (before?.epoch !== epoch && before && stamp - before.stamp < 300_000_000n)
    assert.ok(distance(vector(base.translation), vector(before.base.translation)) < 0.5, "odom never jumps");
  const known = maps_to_odom.get(epoch) ?? maps_to_odom.set(epoch, odom).get(epoch);
  assert.ok(distance(vector(known.translation), vector(odom.translation)) < 1e-9, "map -> odom is the epoch's");
  before = { epoch, stamp, base };
}
assert.ok(maps_to_odom.size > 1);
const last_epoch = Math.max(...maps_to_odom.keys());
const [was, is] = [maps_to_odom.get(0), maps_to_odom.get(last_epoch)];
const jump = distance(apply(was, [0, 0, 0]), apply(is, [0, 0, 0]));
assert.ok(jump > 0.3, `the second segment lay ${jump} m off`);

// The map says of itself that it is of an epoch no sooner than its voxels are.
const keyOf = (p) => p.map((v) => Math.floor(v)).join();
const centres = (m) => m.blocks.flatMap((b) => Array.from({ length: 512 }, (_, v) => v).filter((v) => b.occupied[v >> 3] >> (v & 7) & 1)
  .map((v) => [8 * b.x + (v & 7) + 0.5, 8 * b.y + (v >> 3 & 7) + 0.5, 8 * b.z + (v >> 6) + 0.5]));
const shareIn = (points, keys) => points.filter((p) => {
  for (let x = -1; x <= 1; ++x) for (let y = -1; y <= 1; ++y) for (let z = -1; z <= 1; ++z) if (keys.has(keyOf([p[0] + x, p[1] + y, p[2] + z]))) return true;
  return false;
}).length / points.length;
const corrected_at = seen.poses.find((p) => p.epoch === last_epoch).stamp;
for (const m of seen.maps) assert.ok(m.epoch <= (m.stamp < corrected_at ? 0 : last_epoch));
const old = seen.maps.findLast((m) => m.stamp < corrected_at), settled = seen.maps.find((m) => m.epoch === last_epoch), final = seen.maps.at(-1);
const edge = old.voxel_m, keys = new Set(centres(settled).map(keyOf));
// What the second segment added lies elsewhere now, just as far as map -> odom says: the first is where it was.
const home = seen.maps.findLast((m) => m.stamp < BigInt(Math.round((1 + kLeft / 5) * 1e9))) ?? seen.maps[0], homeKeys = new Set(centres(home).map(keyOf));
const added = centres(old).filter((p) => !homeKeys.has(keyOf(p)));
const moved = added.map((p) => apply(is, unapply(was, p.map((v) => v * edge))).map((v) => v / edge));
const [stays, follows] = [shareIn(added, keys), shareIn(moved, keys)];
console.log(`${seen.poses.length} poses, ${seen.maps.length} maps, ${seen.clouds.length} clouds, epochs 0 to ${last_epoch}; map -> odom moved ${jump.toFixed(2)} m;`,
  `of ${added.length} voxels ${(100 * follows).toFixed(1)} % follow it, ${(100 * stays).toFixed(1)} % are where they were`);
assert.ok(added.length > 1000 && follows > 0.85 && stays < 0.5);
// The cloud of that epoch is the same map.
const cloud = seen.clouds.at(-1), view = new DataView(cloud.points.buffer, cloud.points.byteOffset, cloud.points.byteLength);
const points = Array.from({ length: cloud.points.length / 16 }, (_, k) => [0, 4, 8].map((at) => view.getFloat32(16 * k + at, true) / edge));
assert.equal(cloud.epoch, last_epoch);
const inCloud = shareIn(points, new Set(centres(final).map(keyOf)));
assert.ok(points.length > 1000 && inCloud > 0.98, `${inCloud} of the cloud is in the blocks`);
