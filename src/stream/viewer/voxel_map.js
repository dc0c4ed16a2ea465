// SPDX-License-Identifier: Apache-2.0
// The map: voxels in one buffer, each slot's in a run of its own that is reused by size.
const kVoxelBytes = 12, kPage = 4096, kRun = 32;
const map = {
  voxel_m: 0.04, count: 0, capacity: 0, used: 0, slots: new Map(), free: new Map(), dirty: new Set(), grown: true,
  clear() {
    Object.assign(this, { count: 0, used: 0, capacity: 1 << 16, grown: true });
    this.slots.clear(); this.free.clear(); this.dirty.clear();
    this.bytes = new Uint8Array(this.capacity * kVoxelBytes);
    this.shorts = new Int16Array(this.bytes.buffer);
  },
  run(size) {
    const spare = this.free.get(size);
    if (spare?.length) return spare.pop();
    const begin = this.used;
    this.used += size;
    if (this.used > this.capacity) {
      while (this.used > this.capacity) this.capacity *= 2;
      const bytes = new Uint8Array(this.capacity * kVoxelBytes);
      bytes.set(this.bytes);
      this.bytes = bytes; this.shorts = new Int16Array(bytes.buffer); this.grown = true;
    }
    return begin;
  },
  set(slot, at, bits, colours) {
    const n = colours.length / 3, size = Math.ceil(n / kRun) * kRun;
    let own = this.slots.get(slot);
    if (own && own.size !== size) {
      this.bytes.fill(0, own.begin * kVoxelBytes, (own.begin + own.size) * kVoxelBytes);
      this.touch(own);
      if (!this.free.has(own.size)) this.free.set(own.size, []);
      this.free.get(own.size).push(own.begin);
      this.count -= own.n; this.slots.delete(slot); own = undefined;
    }
    if (n === 0) return;
    if (!own) { own = { begin: this.run(size), size, n: 0 }; this.slots.set(slot, own); }
    this.count += n - own.n; own.n = n;
    let to = own.begin;
    for (let v = 0; v < 512; ++v) {
      if (!(bits[v >> 3] >> (v & 7) & 1)) continue;
      const k = 3 * (to - own.begin), s = to * 6, b = to * kVoxelBytes + 8;
      this.shorts[s] = 8 * at[0] + (v & 7); this.shorts[s + 1] = 8 * at[1] + (v >> 3 & 7); this.shorts[s + 2] = 8 * at[2] + (v >> 6);
      this.bytes[b] = colours[k]; this.bytes[b + 1] = colours[k + 1]; this.bytes[b + 2] = colours[k + 2]; this.bytes[b + 3] = 255;
      ++to;
    }
    this.bytes.fill(0, to * kVoxelBytes, (own.begin + own.size) * kVoxelBytes);
    this.touch(own);
  },
  touch(own) { for (let p = Math.floor(own.begin / kPage); p <= Math.floor((own.begin + own.size - 1) / kPage); ++p) this.dirty.add(p); },
};
const kNoBytes = new Uint8Array(0);
function takeBlocks(data) {
  new Reader(data).each((n, v) => {
    if (n === 3) map.voxel_m = v;
    if (n !== 7) return;
    let slot = 0, bits = kNoBytes, colours = kNoBytes;
    const at = [0, 0, 0];
    new Reader(v).each((m, w) => {
      if (m === 1) slot = w; else if (m <= 4) at[m - 2] = zigzag(w); else if (m === 5) bits = w; else if (m === 6) colours = w;
    });
    map.set(slot, at, bits, colours);
  });
}
