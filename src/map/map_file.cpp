// SPDX-License-Identifier: Apache-2.0
#include "map/map_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <vector>

namespace stillmap {

namespace {

static_assert(std::endian::native == std::endian::little, "the file holds what lies in memory");
static_assert(std::is_trivially_copyable_v<Voxel>);

constexpr std::array<char, 8> kMagic{'s', 't', 'i', 'l', 'l', 'm', 'a', 'p'};
constexpr std::uint32_t kVersion = 3;

struct BlockHead {
  std::int32_t x = 0, y = 0, z = 0;
  std::uint32_t anchor_keyframe = 0;
  std::uint64_t fused_sequence = 0, changed_sequence = 0;
};
static_assert(sizeof(BlockHead) == 32);
constexpr std::size_t kVoxelBytes = kBlockVoxels * sizeof(Voxel);
constexpr std::size_t kBlockBytes = sizeof(BlockHead) + kVoxelBytes;

struct Header {
  std::array<char, 8> magic = kMagic;
  std::uint32_t version = kVersion, block_bytes = kBlockBytes;
  double voxel_m = 0;
  std::uint64_t camera_hash = 0, z_is_up = 0;
};
static_assert(sizeof(Header) == 40);

struct Footer {
  std::uint64_t blocks = 0, keyframe_bytes = 0, checksum = 0;
};
static_assert(sizeof(Footer) == 24);

template <class T>
T taken_from(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

Error unreadable(const std::string& path, const std::string& what) {
  return {ExitCode::UnreadableInput, path + ": " + what};
}

/// Header and footer fit each other and the file.
Status check_bytes(const std::string& path, const std::vector<char>& bytes) {
  const Header header = taken_from<Header>(bytes.data());
  if (header.magic != kMagic)
    return unreadable(path, "is no Stillmap map; name a file that a run wrote with --map NAME.stillmap");
  if (header.version != kVersion || header.block_bytes != kBlockBytes)
    return unreadable(path, "is a map of version " + std::to_string(header.version) +
                                ", this program reads " + std::to_string(kVersion) +
                                "; use the program that wrote it");
  const Footer footer = taken_from<Footer>(bytes.data() + bytes.size() - sizeof(Footer));
  const std::size_t body = bytes.size() - sizeof(Header) - sizeof(Footer);
  if (footer.keyframe_bytes > body || (body - footer.keyframe_bytes) % kBlockBytes != 0 ||
      footer.blocks != (body - footer.keyframe_bytes) / kBlockBytes)
    return unreadable(path, "is cut off; copy it again or take an earlier one");
  if (footer.checksum != fnv1a(bytes.data(), bytes.size() - sizeof(footer.checksum)) ||
      !(header.voxel_m >= 0.001 && header.voxel_m <= 10))
    return unreadable(path, "is damaged (its checksum does not fit); copy it again or take an earlier one");
  return {};
}

bool is_in_reach(const BlockHead& head) {
  constexpr std::int32_t kReach =
      1 << 24;  // blocks: farther than any robot goes, near enough to calculate with
  return std::ranges::all_of(std::array{head.x, head.y, head.z},
                             [](std::int32_t c) { return c > -kReach && c < kReach; });
}

void put_block(const char* from, const BlockHead& head, BlockTable& table) {
  const BlockCoordinates at{head.x, head.y, head.z};
  std::array<Voxel, kBlockVoxels> read;
  std::memcpy(read.data(), from + sizeof(head), kVoxelBytes);
  int index = table.find(at);
  const bool twice = index != BlockTable::kNone;
  if (!twice) index = table.find_or_add(at, head.anchor_keyframe);
  const std::span<Voxel, kBlockVoxels> voxels = table.voxels(index);
  const bool newer = !twice || head.fused_sequence > table.block(index).fused_sequence;
  if (twice) newer ? fill_in(read, voxels) : fill_in(voxels, read);
  if (newer) std::ranges::copy(read, voxels.begin());
  const auto occupied =
      static_cast<int>(std::ranges::count_if(voxels, [](const Voxel& v) { return v.occupied(); }));
  if (newer) table.note_fused(index, head.changed_sequence, true, occupied);
  table.note_fused(index, std::max(head.fused_sequence, table.block(index).fused_sequence), false, occupied);
}

}  // namespace

std::uint64_t calibration_hash(const CameraModel& c) {
  const std::array<double, 12> numbers{static_cast<double>(c.width),
                                       static_cast<double>(c.height),
                                       c.fx,
                                       c.fy,
                                       c.cx,
                                       c.cy,
                                       c.k1,
                                       c.k2,
                                       c.p1,
                                       c.p2,
                                       c.k3,
                                       c.depth_units_per_m};
  return fnv1a(numbers.data(), sizeof(numbers));
}

MapFileWriter::MapFileWriter(const std::string& path, const MapFacts& facts, Nanoseconds timeout_ns,
                             EarlierFile* earlier)
    : file_(path, timeout_ns, earlier) {
  Header header;
  header.voxel_m = facts.voxel_m;
  header.camera_hash = facts.camera_hash;
  header.z_is_up = facts.z_is_up ? 1 : 0;
  file_.append(&header, sizeof(header));
}

void MapFileWriter::append(const Block& block, std::span<const Voxel, kBlockVoxels> voxels) {
  const BlockHead head{block.at.x,           block.at.y,
                       block.at.z,           block.anchor_keyframe,
                       block.fused_sequence, block.changed_sequence};
  file_.append(&head, sizeof(head));
  file_.append(voxels.data(), kVoxelBytes);
  ++blocks_;
}

void MapFileWriter::append_keyframes(std::span<const std::byte> bytes) {
  file_.append(bytes.data(), bytes.size());
  keyframe_bytes_ += bytes.size();
}

Status MapFileWriter::finish() {
  file_.append(&blocks_, sizeof(blocks_));
  file_.append(&keyframe_bytes_, sizeof(keyframe_bytes_));
  const std::uint64_t checksum = file_.checksum();
  file_.append(&checksum, sizeof(checksum));
  return file_.finish();
}

void append_blocks(const BlockTable& blocks, MapFileWriter& writer) {
  for (int i = 0; i < blocks.size(); ++i) {
    if (blocks.found(i)) writer.append(blocks.block(i), blocks.voxels(i));
  }
}

Result<MapFile> read_map_file(const std::string& path) {
  // A folder can be opened as well and has a size, and a pipe keeps waiting who opens it.
  std::error_code unknown;
  std::ifstream file;
  if (std::filesystem::is_regular_file(path, unknown)) file.open(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = file.is_open() ? std::streamoff{file.tellg()} : -1;
  if (size < 0) return unreadable(path, "cannot be opened; check the name and the permissions");
  if (static_cast<std::size_t>(size) < sizeof(Header) + sizeof(Footer))
    return unreadable(path, "is no Stillmap map; name a file that a run wrote with --map NAME.stillmap");
  std::vector<char> bytes(static_cast<std::size_t>(size));
  file.seekg(0);
  if (!file.read(bytes.data(), static_cast<std::streamsize>(size)))
    return unreadable(path, "cannot be read; check the disk");
  if (Status s = check_bytes(path, bytes); !s.ok()) return s.error();

  const Header header = taken_from<Header>(bytes.data());
  const Footer footer = taken_from<Footer>(bytes.data() + bytes.size() - sizeof(Footer));
  const auto blocks = static_cast<std::size_t>(footer.blocks);  // of a file that memory holds
  MapFile map;
  map.facts = {header.voxel_m, header.camera_hash, header.z_is_up != 0};
  Arena planning;
  static_cast<void>(BlockTable(planning, std::max<std::size_t>(blocks, 1)));
  map.memory = std::make_unique<Arena>(planning.bytes_planned());
  map.blocks = std::make_unique<BlockTable>(*map.memory, std::max<std::size_t>(blocks, 1));
  for (std::size_t i = 0; i < blocks; ++i) {
    const char* block = bytes.data() + sizeof(Header) + i * kBlockBytes;
    const BlockHead head = taken_from<BlockHead>(block);
    if (!is_in_reach(head))
      return unreadable(path, "has a block farther off than a robot goes; take an earlier one");
    put_block(block, head, *map.blocks);
  }
  const std::span<const std::byte> all = std::as_bytes(std::span(bytes));
  const auto keyframes =
      all.subspan(sizeof(Header) + blocks * kBlockBytes, static_cast<std::size_t>(footer.keyframe_bytes));
  map.keyframes.assign(keyframes.begin(), keyframes.end());
  return map;
}

}  // namespace stillmap
