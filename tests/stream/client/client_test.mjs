// SPDX-License-Identifier: Apache-2.0
// node client_test.mjs SERVER: what the official client, and some unkind ones, get from the stream server.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import net from "node:net";
import { createInterface } from "node:readline";
import { execFileSync } from "node:child_process";
import { chmodSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import https from "node:https";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, afterEach, before, test } from "node:test";
import { setTimeout as sleep } from "node:timers/promises";

import { foxgloveMessageSchemas, generateProto } from "@foxglove/schemas/internal.js";
import wsProtocol from "@foxglove/ws-protocol";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor.js";
import WebSocket from "ws";

const { FoxgloveClient } = wsProtocol;
const kPoints = 200_000;
let server, lines, port;
const sockets = [];  // of the running test

/// The next line that the server prints.
const nextLine = async () => (await lines.next()).value;
async function stats() {
  server.stdin.write("stats\n");
  return JSON.parse(await nextLine());
}
async function until(what, condition, timeout_ms = 240_000) {
  for (const end = Date.now() + timeout_ms; Date.now() < end; await sleep(20)) if (await condition()) return;
  assert.fail(`waited ${timeout_ms} ms for ${what}`);
}

/// What was under way has arrived: nothing more came for that long. A busy machine takes its time.
async function settled(count, quiet_ms) {
  for (let before; before !== count(); ) {
    before = count();
    await sleep(quiet_ms);
  }
}

function connect(protocols = ["foxglove.websocket.v1"]) {
  const socket = new WebSocket(`ws://127.0.0.1:${port}`, protocols);
  sockets.push(socket);
  const client = new FoxgloveClient({ ws: socket });
  const seen = { socket, client, channels: [], status: [], messages: new Map(), decoders: new Map(), times: new Map() };
  const topics = new Map();
  client.on("serverInfo", (event) => (seen.info = event));
  client.on("status", (event) => seen.status.push(event));
  client.on("close", (event) => (seen.closed = event));
  client.on("advertise", (channels) => {
    seen.channels.push(...channels);
    for (const c of channels) {
      const set = descriptor.FileDescriptorSet.decode(Buffer.from(c.schema, "base64"));
      seen.decoders.set(c.topic, protobuf.Root.fromDescriptor(set).lookupType(c.schemaName));
    }
  });
  client.on("message", ({ subscriptionId, timestamp, data }) => {
    const topic = topics.get(subscriptionId);
    const message = seen.decoders.get(topic).decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    if (!seen.messages.has(topic)) seen.messages.set(topic, []);
    seen.messages.get(topic).push({ timestamp, message, time: Date.now() });
  });
  seen.count = (topic) => seen.messages.get(topic)?.length ?? 0;
  seen.subscribe = (topic) => {
    const id = client.subscribe(seen.channels.find((c) => c.topic === topic).id);
    topics.set(id, topic);
    return id;
  };
  seen.ready = () => until("the channels", () => seen.channels.length === 10);
  return seen;
}

/// A client without any library: shakes hands, sends what it is given, and reads only when told to.
async function rawClient() {
  const socket = net.connect(port, "127.0.0.1");
  sockets.push(socket);
  socket.on("error", () => {});
  await once(socket, "connect");
  socket.write("GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n" +
               "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.websocket.v1\r\n\r\n");
  // All of the greeting, or it would be taken for what comes after.
  for (let greeting = ""; !greeting.includes("foxglove.Log"); ) greeting += (await once(socket, "data"))[0].toString("latin1");
  return {
    socket,
    send(text) {
      const body = Buffer.from(text);
      const length = body.length < 126 ? [0x80 | body.length] : [0x80 | 126, body.length >> 8, body.length & 255];
      socket.write(Buffer.concat([Buffer.from([0x81, ...length, 0, 0, 0, 0]), body]));  // masked by zeros
    },
  };
}
const kSubscribeAll = '{"op":"subscribe","subscriptions":[' + [1, 2, 3, 4, 5].map((i) => `{"id":${i},"channelId":${i}}`) + "]}";

function checkPose({ timestamp, message }) {
  const i = Number((timestamp - 1_700_000_000_000_000_000n) / 10_000_000n);
  assert.equal(BigInt(message.timestamp.seconds) * 1_000_000_000n + BigInt(message.timestamp.nanos), timestamp);
  assert.deepEqual([message.frameId, message.epoch], ["map", 5]);
  // T_map_odom turns by 90 degrees about z and shifts by (1, 2, 3): x of odom is y of map.
  const { position: p, orientation: q } = message.pose;
  for (const [got, want] of [[p.x, 1], [p.y, 2 + 0.01 * i], [p.z, 3.5], [q.x, 0], [q.y, 0], [q.z, Math.SQRT1_2],
                             [q.w, Math.SQRT1_2]]) {
    assert.ok(Math.abs(got - want) < 1e-9, `${got} is not ${want}`);
  }
  return i;
}

/// Poses come in order, and each that a busy machine had no time for is counted.
async function checkPoses(messages, start) {
  const numbers = messages.map(checkPose), now = await stats();
  for (let i = 1; i < numbers.length; ++i) assert.ok(numbers[i] > numbers[i - 1]);
  const missing = numbers.at(-1) - numbers[0] + 1 - numbers.length;
  const counted = now.dropped + now.poses_refused - start.dropped - start.poses_refused;
  assert.ok(missing <= counted, `${missing} poses are missing, ${counted} are counted`);
}

function checkCloud({ timestamp, message }) {
  assert.equal(timestamp % 1_000_000_000n, 7n);
  const generation = Number(timestamp / 1_000_000_000n);
  assert.deepEqual([message.frameId, message.epoch], ["map", 4]);
  assert.equal(message.pointStride, 16);
  assert.deepEqual(message.fields.map((f) => [f.name, f.offset, f.type]), [["x", 0, 7], ["y", 4, 7], ["z", 8, 7],
                   ["red", 12, 1], ["green", 13, 1], ["blue", 14, 1], ["alpha", 15, 1]]);
  assert.equal(message.pose.orientation.w, 1);
  assert.equal(message.data.length, 16 * kPoints);
  const view = new DataView(message.data.buffer, message.data.byteOffset, message.data.byteLength);
  for (let k = 0; k < kPoints; ++k) {  // not assert.equal: 1.4 million of them take seconds
    const ok = view.getFloat32(16 * k, true) === Math.fround(Math.fround(0.001) * Math.fround(k)) &&
      view.getFloat32(16 * k + 4, true) === -k && view.getFloat32(16 * k + 8, true) === generation &&
      view.getUint32(16 * k + 12, true) === ((0xff000000 | k) >>> 0);
    assert.ok(ok, `point ${k} of cloud ${generation}`);
  }
  return generation;
}

before(async () => {
  server = spawn(process.argv[2], { stdio: ["pipe", "pipe", "inherit"] });
  lines = createInterface({ input: server.stdout })[Symbol.asyncIterator]();
  port = Number(await nextLine());
});

/// Another server, with options, for the length of one test.
async function withServer(options, run) {
  const other = spawn(process.argv[2], options, { stdio: ["pipe", "pipe", "pipe"] });
  let words = "";
  other.stderr.on("data", (text) => (words += text));
  const out = createInterface({ input: other.stdout })[Symbol.asyncIterator]();
  const answer = await Promise.race([out.next(), once(other, "exit").then(() => ({ done: true }))]);
  try {
    await run(answer.done ? null : Number(answer.value), () => words, other, out);
  } finally {
    other.kill();
  }
}
/// How a WebSocket handshake ends: "open", or the HTTP status.
const handshake = (address, options = {}) => new Promise((resolve) => {
  const socket = new WebSocket(address, ["foxglove.websocket.v1"], options);
  sockets.push(socket);
  socket.on("open", () => resolve("open"));
  socket.on("unexpected-response", (_, response) => resolve(response.statusCode));
  socket.on("error", () => resolve("error"));
});

afterEach(async () => {
  for (const socket of sockets.splice(0)) socket instanceof WebSocket ? socket.terminate() : socket.destroy();
  if (server.exitCode === null) await until("all clients to be gone", async () => (await stats()).clients === 0);
});

after(() => server.kill());

test("greets with serverInfo and channels whose schemas are the official ones and an epoch", async () => {
  const c = connect();
  await c.ready();
  assert.equal(c.socket.protocol, "foxglove.websocket.v1");
  assert.equal(c.info.name, "stillmap");
  assert.deepEqual(c.info.capabilities, []);
  assert.deepEqual(c.channels.map((x) => [x.topic, x.schemaName]),
                   [["/tf", "foxglove.FrameTransforms"], ["/pose", "foxglove.PoseInFrame"], ["/map", "foxglove.PointCloud"],
                    ["/map/blocks", "stillmap.MapBlocks"], ["/objects", "foxglove.SceneUpdate"],
                    ["/camera/color", "foxglove.CompressedImage"], ["/camera/annotations", "foxglove.ImageAnnotations"],
                    ["/camera/calibration", "foxglove.CameraCalibration"], ["/health", "stillmap.Health"], ["/log", "foxglove.Log"]]);
  assert.ok(c.channels.every((x) => x.encoding === "protobuf" && x.schemaEncoding === "protobuf"));
  for (const [topic, decoder] of c.decoders) {
    if (c.channels.find((x) => x.topic === topic).schemaName.startsWith("stillmap.")) continue;
    for (const type of decoder.parent.nestedArray.filter((t) => t instanceof protobuf.Type)) {
      const schema = foxgloveMessageSchemas[type.name];
      const enums = type.nestedArray.map(() => schema.fields.find((f) => f.type.type === "enum").type.enum);
      const source = generateProto(schema, enums);
      const official = protobuf.parse(source, { keepCase: true }).root.lookupType(`foxglove.${type.name}`);
      const shape = (t) => Object.fromEntries(t.fieldsArray.map((f) =>
          [f.name.replace(/_([a-z])/g, (_, x) => x.toUpperCase()), [f.id, f.type.split(".").at(-1), f.repeated]]));
      const ours = ["PoseInFrame", "FrameTransforms", "PointCloud"].includes(type.name) ? { epoch: [1000, "uint32", false] } : {};
      assert.deepEqual(shape(type), { ...shape(official), ...ours }, type.name);
      for (const e of type.nestedArray) assert.deepEqual({ ...e.values }, { ...official.get(e.name).values }, e.name);
    }
  }
});

test("serves the sdk's subprotocol alike, prefers none, and refuses others", async () => {
  const sdk = connect(["foxglove.sdk.v1", "foxglove.websocket.v1"]);
  await sdk.ready();
  assert.equal(sdk.socket.protocol, "foxglove.sdk.v1");
  sdk.subscribe("/pose");
  await until("a pose", () => sdk.count("/pose") > 0);
  checkPose(sdk.messages.get("/pose")[0]);
  sdk.client.close();
  const bare = connect([]);
  await bare.ready();
  bare.client.close();
  const other = new WebSocket(`ws://127.0.0.1:${port}`, ["chat.v1"]);
  await new Promise((resolve) => other.on("error", resolve));
});

test("poses and transforms arrive every frame, in order, with the values that were published", async () => {
  const c = connect(), start = await stats();
  await c.ready();
  c.subscribe("/pose");
  c.subscribe("/tf");
  await until("100 poses", () => c.count("/pose") > 100 && c.count("/tf") > 100);
  await checkPoses(c.messages.get("/pose"), start);
  for (const { timestamp, message } of c.messages.get("/tf")) {
    const i = Number((timestamp - 1_700_000_000_000_000_000n) / 10_000_000n);
    const [odom, base, camera] = message.transforms;
    assert.equal(message.epoch, 5);
    assert.deepEqual(message.transforms.map((t) => [t.parentFrameId, t.childFrameId]),
                     [["map", "odom"], ["odom", "base"], ["base", "camera"]]);
    assert.ok(Math.abs(base.translation.x - 0.01 * i) < 1e-9 && odom.translation.z === 3 && camera.translation.z === 0.5);
    assert.ok(Math.abs(odom.rotation.z - Math.SQRT1_2) < 1e-9 && camera.rotation.w === 1);
  }
});

test("a client that receives poses and clouds costs the library no heap", async () => {
  const c = connect();
  await c.ready();
  for (const { topic } of c.channels) c.subscribe(topic);
  await until("a cloud and a picture", () => c.count("/map") > 0 && c.count("/camera/color") > 0);
  const [start, poses] = [await stats(), c.count("/pose")];
  await until("100 more poses and 2 clouds", () => c.count("/pose") > poses + 100 && c.count("/map") > 2);
  assert.equal((await stats()).allocations, start.allocations);
});

test("the map comes whole on subscribing, then at most once a second, and an unchanged one to newcomers", async () => {
  const c = connect();
  await c.ready();
  c.subscribe("/map");
  const subscribed = Date.now();
  await until("3 clouds", () => c.count("/map") >= 3);
  const clouds = c.messages.get("/map");
  const generations = clouds.map(checkCloud);
  for (let i = 1; i < clouds.length; ++i) {
    assert.ok(generations[i] > generations[i - 1]);
    // A second at least lies between two, which may arrive late, but not early.
    assert.ok(clouds[i].time - subscribed > 800 * (i - 1), `${clouds[i].time - subscribed} ms`);
  }
  server.stdin.write("freeze\n");
  await settled(() => c.count("/map"), 1500);  // and the buffer is offered again
  const before = c.count("/map");
  const late = connect();
  await late.ready();
  late.subscribe("/map");
  await until("the kept cloud", () => late.count("/map") === 1);
  assert.equal(checkCloud(late.messages.get("/map")[0]), checkCloud(c.messages.get("/map").at(-1)));
  await sleep(1500);
  assert.equal(c.count("/map"), before, "nothing is sent while nothing changes");
  server.stdin.write("thaw\n");
  await until("the changed cloud at both", () => late.count("/map") > 1 && c.count("/map") > before);
});

test("objects are boxes in the map with class, speed and age, which end by themselves", async () => {
  const c = connect();
  await c.ready();
  const subscribed = Date.now();
  c.subscribe("/objects");
  await until("objects", () => c.count("/objects") > 2);
  const { entities: [walker], deletions } = c.messages.get("/objects")[0].message;
  assert.deepEqual([deletions.length, walker.id, walker.frameId, walker.lifetime.nanos], [0, "object 7", "map", 5e8]);
  assert.deepEqual(walker.metadata.map((m) => [m.key, m.value]),
                   [["class", "person"], ["kind", "dynamic"], ["speed_m_s", "1.00"], ["age_s", "1.50"]]);
  const [{ size, pose: { position } }] = walker.cubes;  // box 200 x 320 px at 2.25 m with a focal length of 500 px, 0.5 m deep
  for (const [got, want] of [[size.x, 0.9], [size.y, 1.44], [size.z, 0.5], [position.x, (300 - 320) / 500 * 2.25], [position.z, 2.25]])
    assert.ok(Math.abs(got - want) < 1e-5, `${got} is not ${want}`);
  assert.equal(walker.texts[0].text, "person 1.0 m/s");
  assert.ok(Math.abs(walker.arrows[0].shaftLength - 0.8) < 1e-9);
  // At least 50 ms lie between two, which may arrive late, but not early.
  const times = c.messages.get("/objects").map((m) => m.time - subscribed);
  assert.ok(times.every((ms, i) => ms >= 50 * (i - 1)), `${times}`);
});

/// The grey values of a JPEG, by the one decoder that everyone has.
function pixels(jpeg) {
  const script = "import sys,cv2,numpy as n; a=cv2.imdecode(n.frombuffer(sys.stdin.buffer.read(),n.uint8),0); sys.stdout.buffer.write(bytes(n.array(a.shape,n.uint16))+a.tobytes())";
  const out = execFileSync("/usr/bin/python3", ["-c", script], { input: jpeg });
  const [height, width] = [out.readUInt16LE(0), out.readUInt16LE(2)];
  return { width, height, at: (x, y) => out[4 + y * width + x] };
}
/// How much neighbours differ in a part of a picture: the test's stripes by nearly all, a pixelated part by nothing.
function contrast(picture, x0, x1, y0, y1) {
  let sum = 0;
  for (let y = y0; y < y1; ++y) for (let x = x0; x + 2 < x1; ++x) sum += Math.abs(picture.at(x, y) - picture.at(x + 2, y));
  return sum / ((x1 - x0 - 2) * (y1 - y0));
}

test("the preview is half the size, people in it are pixelated, and its annotations and calibration fit it", async () => {
  const c = connect();
  await c.ready();
  for (const topic of ["/camera/color", "/camera/annotations", "/camera/calibration"]) c.subscribe(topic);
  await until("pictures", () => c.count("/camera/color") > 2 && c.count("/camera/annotations") > 2);
  const { message: image, timestamp } = c.messages.get("/camera/color")[1];
  assert.deepEqual([image.format, image.frameId], ["jpeg", "camera"]);
  const picture = pixels(image.data);
  assert.deepEqual([picture.width, picture.height], [320, 240]);
  assert.ok(contrast(picture, 0, 60, 0, 240) > 100, "what is nobody's is sharp");
  assert.ok(contrast(picture, 100, 200, 50, 210) < 12, "what is somebody's is not");
  assert.ok(contrast(picture, 92, 100, 60, 200) < 12 && contrast(picture, 200, 208, 60, 200) < 12, "nor is a margin");
  const annotation = c.messages.get("/camera/annotations").find((m) => m.timestamp === timestamp).message;
  const outline = annotation.points.find((p) => p.type === 2);
  assert.deepEqual(outline.points.map((p) => [p.x, p.y]), [[99.75, 49.75], [199.75, 49.75], [199.75, 209.75], [99.75, 209.75]]);
  assert.equal(annotation.points.filter((p) => p.type === 1).length, 4);
  assert.equal(annotation.texts[0].text, "person 0.90");
  const { message: k } = c.messages.get("/camera/calibration")[0];
  assert.deepEqual([k.width, k.height, k.K, k.distortionModel], [320, 240, [250, 0, 159.75, 0, 250, 119.75, 0, 0, 1], "plumb_bob"]);
  assert.equal(c.count("/camera/calibration"), 1);
});

test("nobody who does not ask costs a picture", async () => {
  const before = await stats();
  await sleep(400);
  assert.equal((await stats()).pictures, before.pictures);
});

test("a preview that is off has no topic, and a full one hides nobody", async () => {
  await withServer(["--preview", "off"], async (other) => {
    const socket = new WebSocket(`ws://127.0.0.1:${other}`, ["foxglove.websocket.v1"]);
    let words = "";
    socket.on("message", (data) => (words += data));
    await until("the channels", () => words.includes("foxglove.Log"));
    assert.ok(!words.includes("/camera/color"));
    socket.terminate();
  });
  await withServer(["--preview", "full"], async (other) => {
    const own = port;
    port = other;
    const c = connect();
    port = own;
    await c.ready();
    c.subscribe("/camera/color");
    await until("a picture", () => c.count("/camera/color") > 0);
    assert.ok(contrast(pixels(c.messages.get("/camera/color")[0].message.data), 100, 200, 50, 210) > 100);
    c.socket.terminate();
  });
});

test("the map's blocks come as a snapshot, then as what changed and what went, in sequence", async () => {
  const c = connect();
  await c.ready();
  c.subscribe("/map/blocks");
  const slots = new Map(), messages = () => c.messages.get("/map/blocks") ?? [];
  const removed = (m) => m.message.blocks.some((b) => b.slot === 1 && b.occupied.length === 0);
  // The server puts a block in and takes it out in turn; who is slow may see several changes as one.
  await until("changes, the removal of a block among them", () => messages().length > 6 && messages().some(removed));
  const first = messages().findIndex((m) => m.message.complete);
  for (const [i, { message: m }] of messages().entries()) {
    assert.equal(Number(m.sequence ?? 0), i);
    assert.deepEqual([m.frameId, m.voxelM, Boolean(m.snapshot), m.epoch], ["map", 0.04, i <= first, 4]);
    for (const b of m.blocks) slots.set(b.slot, b);
    if (i === first) assert.ok(slots.size >= 299 && slots.has(0) && slots.has(299));
    if (i > first) assert.deepEqual(m.blocks.map((b) => b.slot), [1], "only what changed");
  }
  const block = slots.get(299);
  assert.deepEqual([block.x, block.y, block.z], [49, 2, -1]);
  assert.deepEqual([...block.occupied].map((b) => b === 255), Array.from({ length: 64 }, (_, i) => i < 8));
  assert.deepEqual([block.colours.length, ...block.colours.slice(0, 3)], [192, 43, 1, 200]);
  server.stdin.write("freeze\n");
  await settled(() => messages().length, 600);
  const count = messages().length;
  const late = connect();
  await late.ready();
  late.subscribe("/map/blocks");
  await until("the snapshot for a newcomer", () => late.messages.get("/map/blocks")?.some((m) => m.message.complete));
  assert.ok(messages().length <= count + 1, "nothing is sent while nothing changes");
  server.stdin.write("thaw\n");
});

test("health tells how the runtime does, and the log's last lines are kept for newcomers", async () => {
  const c = connect();
  await c.ready();
  c.subscribe("/health");
  c.subscribe("/log");
  await until("both", () => c.count("/health") > 0 && c.count("/log") >= 64);
  const health = c.messages.get("/health")[0].message;
  assert.deepEqual([health.state, health.fps, health.latencyMs, Number(health.rssBytes)], ["tracking", 29.5, 12.5, 96e6]);
  const log = c.messages.get("/log").map((m) => m.message);
  assert.deepEqual([log.length, log[0].message, log.at(-1).message, log[0].level, log[0].name], [64, "line 6", "line 69", 3, "track"]);
});

test("on loopback without a token, foreign pages and foreign host names are turned away", async () => {
  const address = `ws://127.0.0.1:${port}`;
  for (const origin of [`http://127.0.0.1:${port}`, "https://app.foxglove.dev", "https://lichtblick-suite.github.io"])
    assert.equal(await handshake(address, { origin }), "open", origin);
  for (const origin of ["https://evil.example", "null", "file://", `http://127.0.0.1:${port + 1}`, "https://app.foxglove.dev.evil.example"])
    assert.equal(await handshake(address, { origin }), 403, origin);
  // A page that has its own name lead to this machine is of the same origin as the name.
  assert.equal(await handshake(address, { origin: "http://evil.example", headers: { host: "evil.example" } }), 403);
  assert.equal(await handshake(address, { headers: { host: "localhost:1" } }), "open");
});

test("beyond loopback there must be a token, which opens page and stream by address or cookie", async () => {
  const folder = mkdtempSync(path.join(tmpdir(), "stillmap-"));
  const [file, token] = [path.join(folder, "token"), "0123456789abcdef-~"];
  try {
    await withServer(["--listen", "0.0.0.0:0"], async (other, words) => {
      await until("the refusal", () => words().includes("stream.token_file"));
      assert.equal(other, null);
    });
    writeFileSync(file, token + "\n");
    chmodSync(file, 0o644);
    await withServer(["--listen", "0.0.0.0:0", "--token", file], async (other, words) => {
      await until("the refusal", () => words().includes("chmod 600"));
      assert.ok(other === null && !words().includes(token));
    });
    chmodSync(file, 0o600);
    await withServer(["--listen", "0.0.0.0:0", "--token", file], async (other, words) => {
      const at = `127.0.0.1:${other}`;
      for (const query of ["", "?token=", "?token=0123456789abcdef-", `?token=${token}x`, `?other=${token}`]) {
        assert.equal(await handshake(`ws://${at}/${query}`), 401, query);
        const refused = await fetch(`http://${at}/${query}`);
        assert.equal(refused.status, 401);
        assert.equal(refused.headers.get("set-cookie"), null);
      }
      const page = await fetch(`http://${at}/?token=${token}`);
      const cookie = page.headers.get("set-cookie");
      assert.match(cookie, /^stillmap_token=[^;]+; HttpOnly; SameSite=Strict; Path=\/$/);
      assert.equal(page.headers.get("referrer-policy"), "no-referrer");
      const headers = { cookie: `a=b; ${cookie.split(";")[0]}; c=d` };
      assert.equal((await fetch(`http://${at}/health`, { headers })).status, 200);
      assert.equal(await handshake(`ws://${at}/`, { headers }), "open");
      assert.equal(await handshake(`ws://${at}/?token=${token}`, { headers: { host: "robot.example" } }), "open");
      assert.equal(await handshake(`ws://${at}/?token=${token}`, { origin: "https://evil.example" }), 403);
      assert.ok(!words().includes(token), "it is never written anywhere");
    });
    await withServer(["--listen", "0.0.0.0:0", "--token", file, "--preview", "full"], async (other, words) => {
      await until("the refusal", () => words().includes("full_preview_to"));
      assert.equal(other, null);
    });
    const [certificate, key] = [path.join(folder, "cert.pem"), path.join(folder, "key.pem")];
    execFileSync("openssl", ["req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1", "-subj", "/CN=localhost", "-keyout", key, "-out", certificate], { stdio: "ignore" });
    await withServer(["--certificate", certificate, "--key", key], async (other) => {
      assert.equal(await handshake(`wss://127.0.0.1:${other}/`, { rejectUnauthorized: false }), "open");
      const status = await new Promise((resolve, reject) => https.get(`https://127.0.0.1:${other}/`, { rejectUnauthorized: false, agent: false, ALPNProtocols: ["h2", "http/1.1"] },  // as browsers ask
        (r) => { r.resume(); resolve(r.statusCode); }).on("error", reject));
      assert.equal(status, 200);
      await assert.rejects(fetch(`http://127.0.0.1:${other}/`, { signal: AbortSignal.timeout(2000) }));
    });
    await withServer(["--certificate", certificate, "--key", file], async (other, words) => {
      await until("the refusal", () => words().includes("are no pair that OpenSSL takes"));
      assert.equal(other, null);
    });
  } finally {
    rmSync(folder, { recursive: true });
  }
});

test("a hundred connects in a second, half-open ones and a flood of messages leave the others alone", async () => {
  const good = connect(), start = await stats();
  await good.ready();
  good.subscribe("/pose");
  await until("a pose", () => good.count("/pose") > 0);
  const poses = good.count("/pose");
  for (let i = 0; i < 100; ++i) {
    const socket = net.connect(port, "127.0.0.1");
    sockets.push(socket);
    socket.on("error", () => {});
    if (i % 4 === 0) socket.write("GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n");  // and never more
    else if (i % 4 === 1) socket.on("connect", () => socket.resetAndDestroy());
    else if (i % 4 === 2) connect().client.close();
    await sleep(10);
  }
  await checkPoses(good.messages.get("/pose"), start);
  await until("poses meanwhile", () => good.count("/pose") > poses + 50);
  const flood = await rawClient();
  await until("the flood to be cut off", async () => {
    for (let i = 0; i < 300; ++i) flood.send("x");
    return (await stats()).given_up > start.given_up;
  });
  // Frames that no client sends: without a mask, of a reserved kind, fragments of a text that never began.
  for (const frame of [[0x81, 1, 120], [0x83, 0x80, 0, 0, 0, 0], [0x80, 0x80, 0, 0, 0, 0], [0x81, 0xff, 255, 255, 255, 255, 255, 255, 255, 255]]) {
    const bad = await rawClient();
    bad.socket.write(Buffer.from(frame));
    if (frame[1] !== 0xff) await Promise.race([once(bad.socket, "close"), sleep(3000)]);
    bad.socket.destroy();
  }
  const before = good.count("/pose");
  await until("poses to go on", () => good.count("/pose") > before + 20);
});

test("after unsubscribing nothing more comes, and one can subscribe again", async () => {
  const c = connect();
  await c.ready();
  const id = c.subscribe("/pose");
  await until("poses", () => c.count("/pose") > 3);
  c.client.unsubscribe(id);
  c.socket.send("hello");  // its answer comes behind all that was sent before
  await until("the answer", () => c.status.length === 1);
  const count = c.count("/pose");
  await sleep(200);
  assert.equal(c.count("/pose"), count);
  c.subscribe("/pose");
  await until("poses again", () => c.count("/pose") > count + 3);
  assert.equal(c.status.length, 1);
});

test("every bad message is answered with a status, counted, and changes nothing", async () => {
  const c = connect();
  await c.ready();
  c.subscribe("/pose");
  const before = (await stats()).bad;
  const bad = ["", "hello", '{"op":"subscribe"}', '{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}',
               '{"op":"subscribe","subscriptions":[{"id":77,"channelId":99}]}',
               '{"op":"subscribe","subscriptions":[{"id":78,"channelId":2}]}',
               '{"op":"unsubscribe","subscriptionIds":[12345]}', '{"op":"setParameters","parameters":[]}',
               '{"op":"advertise","channels":[]}', "[".repeat(3000), `{"op":"${"x".repeat(100_000)}"}`,
               Buffer.from([1, 0, 0, 0, 0, 42])];
  for (const [i, message] of bad.entries()) {
    c.socket.send(message);
    await until(`the answer to ${message.slice(0, 60)}`, () => c.status.length === i + 1);
  }
  assert.ok(c.status.every((s) => s.level === 2 && s.message.length > 10));
  assert.match(c.status[4].message, /no channel 99/);
  assert.match(c.status[6].message, /no subscription 12345/);
  assert.match(c.status[10].message, /4096 bytes/);
  assert.equal((await stats()).bad, before + bad.length);
  const poses = c.count("/pose");
  await until("poses to go on", () => c.count("/pose") > poses + 5);
});

test("a client too many is turned away with a reason, and finds a place when one leaves", async () => {
  const clients = Array.from({ length: 8 }, () => connect());
  await Promise.all(clients.map((c) => c.ready()));
  const ninth = connect();
  await until("the refusal", () => ninth.closed);
  assert.equal(ninth.closed.code, 1013);
  assert.match(ninth.closed.reason, /stream\.max_clients/);
  assert.equal(ninth.info, undefined);
  assert.equal((await fetch(`http://127.0.0.1:${port}/health`)).status, 200);
  clients.pop().client.close();
  await until("the place", async () => (await stats()).clients === 7);
  const next = connect();
  await next.ready();
  const end = await stats();
  assert.equal(end.peak, 8);
  assert.ok(end.refused >= 1);
});

test("a client that never reads stalls nobody, and is given up on in the middle of a cloud", async () => {
  const good = connect(), before = await stats();
  await good.ready();
  good.subscribe("/pose");
  good.subscribe("/map");
  await until("a cloud", () => good.count("/map") > 0);
  const stuck = await rawClient();
  stuck.socket.pause();
  stuck.send(kSubscribeAll);
  const start = await stats();
  const [poses, clouds, begin] = [good.count("/pose"), good.count("/map"), Date.now()];
  await sleep(3000);
  await checkPoses(good.messages.get("/pose"), before);
  await until("poses meanwhile", () => good.count("/pose") > poses + 100);
  await until("it to be given up on", async () => (await stats()).given_up === start.given_up + 1);
  assert.ok(Date.now() - begin < 60_000);
  await until("clouds to go on", () => good.count("/map") > clouds + 1);
  checkCloud(good.messages.get("/map").at(-1));
});

test("clients that vanish in the middle of a cloud leave nothing behind", async () => {
  const good = connect();
  await good.ready();
  good.subscribe("/map");
  await until("a cloud", () => good.count("/map") > 0);
  for (let i = 0; i < 10; ++i) {
    const raw = await rawClient();
    raw.send(kSubscribeAll);
    await once(raw.socket, "data");
    raw.socket.resetAndDestroy();
  }
  const clouds = good.count("/map");
  await until("whole clouds to go on", () => good.count("/map") > clouds + 1);
  checkCloud(good.messages.get("/map").at(-1));
  await until("their places to be free", async () => (await stats()).clients === 1);
});

test("HTTP: health, metrics and the page, and nothing else", async () => {
  const get = (path, options) => fetch(`http://127.0.0.1:${port}${path}`, options);
  const health = await get("/health");
  assert.equal(health.headers.get("content-type"), "application/json");
  assert.deepEqual(await health.json(), { state: "tracking" });
  const metrics = await get("/metrics");
  assert.match(metrics.headers.get("content-type"), /^text\/plain; version=0\.0\.4/);
  assert.equal(await metrics.text(), "stillmap_up 1\n");
  const page = await get("/");
  assert.match(page.headers.get("content-type"), /^text\/html/);
  assert.match(await page.text(), /Foxglove/);
  assert.match(page.headers.get("content-security-policy"), /default-src 'none'/);
  for (const path of ["/etc/passwd", "/health/", "/index.html", `/${"a".repeat(1500)}`]) {
    assert.equal((await get(path)).status, 404, path);
  }
  for (const method of ["POST", "PUT", "DELETE"]) {
    assert.equal((await get("/health", { method })).status, 405, method);
  }
});

test("garbage, half requests and many idle connections keep no one out", async () => {
  for (let i = 0; i < 60; ++i) {
    const socket = net.connect(port, "127.0.0.1");
    socket.on("error", () => {});
    socket.write(["\x00\x01\x02\xff".repeat(50), "GET /health HTTP/1.1\r\nHost", "GET " + "x".repeat(20_000), ""][i % 4]);
    sockets.push(socket);
  }
  await until("health", async () => {
    try {
      return (await fetch(`http://127.0.0.1:${port}/health`, { signal: AbortSignal.timeout(10_000) })).status === 200;
    } catch {
      return false;
    }
  });
  const c = connect();
  await c.ready();
});

test("stopping says goodbye to every client and waits for none", async () => {
  const clients = [connect(), connect()];
  await Promise.all(clients.map((c) => c.ready()));
  clients[0].subscribe("/map");
  const stuck = await rawClient();
  stuck.socket.pause();
  stuck.send(kSubscribeAll);
  await sleep(300);
  const begin = Date.now();
  server.stdin.write("quit\n");
  const [code] = await once(server, "exit");
  assert.equal(code, 0);
  assert.ok(Date.now() - begin < 15_000, `${Date.now() - begin} ms`);
  await until("the farewells", () => clients.every((c) => c.closed));
  for (const c of clients) assert.equal(c.closed.code, 1001);
});
