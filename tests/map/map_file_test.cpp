// SPDX-License-Identifier: Apache-2.0
#include "map/map_file.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>

#include "map/map_copier.h"
#include "map/map_queries.h"
#include "tests/map/map_scene.h"

namespace {
/// What is asked of the disk, in its order, where a test wants to know.
std::vector<std::string>* asked_of_disk = nullptr;
}  // namespace

// In place of the C library's.
extern "C" int fsync(int file) {
  struct stat status {};
  fstat(file, &status);
  if (asked_of_disk != nullptr)
    asked_of_disk->push_back(S_ISDIR(status.st_mode) ? "sync folder" : "sync file");
  return static_cast<int>(syscall(SYS_fsync, file));
}
extern "C" int rename(const char* from, const char* to) noexcept {
  if (asked_of_disk != nullptr) asked_of_disk->emplace_back("rename");
  return renameat(AT_FDCWD, from, AT_FDCWD, to);
}

namespace stillmap {
namespace {

namespace fs = std::filesystem;
using test::MapUnderTest;

class MapFiles : public testing::Test {
 protected:
  MapFiles() {
    fs::create_directories(folder_);
    map_.see(test::room(), test::turned(0), 3, 7);
    map_.see(test::room(), test::turned(1), 3, 8);
  }
  ~MapFiles() override { fs::remove_all(folder_); }

  const BlockTable& blocks() { return map_.map().blocks(); }
  void write() {
    MapFileWriter writer(path_, kFacts);
    append_blocks(blocks(), writer);
    ASSERT_TRUE(writer.finish().ok());
  }
  std::string contents() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void put(const std::string& bytes) const { std::ofstream(path_, std::ios::binary) << bytes; }
  std::string error_of_reading() const {
    const Result<MapFile> read = read_map_file(path_);
    if (read.ok()) return "none";
    EXPECT_EQ(read.error().exit_code, ExitCode::UnreadableInput);
    EXPECT_NE(read.error().message.find(path_), std::string::npos);
    return read.error().message;
  }

  static constexpr MapFacts kFacts{0.04, 0x1234567890abcdef, true};
  fs::path folder_ = fs::temp_directory_path() / ("stillmap_map_file_" + std::to_string(getpid()));
  std::string path_ = folder_ / "room.stillmap";
  MapUnderTest map_{test::small_camera()};
};

TEST_F(MapFiles, gives_back_every_block_and_voxel) {
  write();
  const Result<MapFile> read = read_map_file(path_);
  ASSERT_TRUE(read.ok()) << read.error().message;
  EXPECT_EQ(read.value().facts.voxel_m, kFacts.voxel_m);
  EXPECT_EQ(read.value().facts.camera_hash, kFacts.camera_hash);
  EXPECT_TRUE(read.value().facts.z_is_up);
  const BlockTable& back = *read.value().blocks;
  ASSERT_EQ(back.size(), blocks().size());
  EXPECT_EQ(back.occupied_voxels(), blocks().occupied_voxels());
  for (int i = 0; i < back.size(); ++i) {
    const Block &a = back.block(i), &b = blocks().block(i);
    ASSERT_EQ(a.at, b.at);
    ASSERT_EQ(a.anchor_keyframe, b.anchor_keyframe);
    ASSERT_EQ(a.fused_sequence, b.fused_sequence);
    ASSERT_EQ(a.changed_sequence, b.changed_sequence);
    ASSERT_EQ(a.occupied, b.occupied);
    ASSERT_EQ(std::memcmp(back.voxels(i).data(), blocks().voxels(i).data(), kBlockVoxels * sizeof(Voxel)), 0);
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1) << "the temporary file stays";
}

TEST_F(MapFiles, a_map_is_on_the_disk_before_it_takes_its_name_and_its_name_before_it_is_done) {
  std::vector<std::string> asked;
  asked_of_disk = &asked;
  write();
  asked_of_disk = nullptr;
  EXPECT_THAT(asked, testing::ElementsAre("sync file", "rename", "sync folder"));
}

TEST_F(MapFiles, an_empty_map_is_a_valid_file) {
  MapFileWriter writer(path_, kFacts);
  ASSERT_TRUE(writer.finish().ok());
  const Result<MapFile> read = read_map_file(path_);
  ASSERT_TRUE(read.ok());
  EXPECT_EQ(read.value().blocks->size(), 0);
}

TEST_F(MapFiles, a_cut_file_is_never_taken_for_a_map) {
  write();
  const std::string whole = contents();
  for (std::size_t length = 0; length < whole.size(); length += whole.size() / 97) {
    put(whole.substr(0, length));
    const std::string said = error_of_reading();
    EXPECT_NE(said.find(length < 64 ? "is no Stillmap map" : "is cut off"), std::string::npos)
        << length << said;
  }
  put(whole.substr(0, whole.size() - 4128));  // a whole block less
  EXPECT_NE(error_of_reading().find("is cut off"), std::string::npos);
}

TEST_F(MapFiles, one_flipped_bit_anywhere_is_found) {
  write();
  const std::string whole = contents();
  for (std::size_t at = 0; at < whole.size(); at += at < 64 ? 1 : whole.size() / 50) {
    std::string flipped = whole;
    flipped[at] = static_cast<char>(flipped[at] ^ (1 << (at % 8)));
    put(flipped);
    EXPECT_NE(error_of_reading(), "none") << at;
  }
}

TEST_F(MapFiles, foreign_missing_and_later_files_are_named) {
  EXPECT_NE(error_of_reading().find("cannot be opened"), std::string::npos);
  put(std::string(5000, 'x'));
  EXPECT_NE(error_of_reading().find("is no Stillmap map"), std::string::npos);
  write();
  std::string later = contents();
  later[8] = 9;
  put(later);
  EXPECT_NE(error_of_reading().find("version 9"), std::string::npos);
  const fs::path pipe = folder_ / "pipe.stillmap";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  for (const fs::path& other : {folder_, pipe}) {
    path_ = other;
    EXPECT_NE(error_of_reading().find("cannot be opened"), std::string::npos) << other;
  }
}

TEST_F(MapFiles, a_block_beyond_reach_is_refused) {
  for (const std::int32_t far : {1 << 24, -(1 << 24), std::numeric_limits<std::int32_t>::min()}) {
    Block block;
    block.at = {0, far, 0};
    MapFileWriter writer(path_, kFacts);
    writer.append(block, std::array<Voxel, kBlockVoxels>{});
    ASSERT_TRUE(writer.finish().ok());
    EXPECT_NE(error_of_reading().find("farther off"), std::string::npos) << far;
  }
}

TEST_F(MapFiles, keyframes_come_back_as_they_went) {
  const std::array<std::byte, 5> keyframes{std::byte{1}, std::byte{2}, std::byte{3}, std::byte{4},
                                           std::byte{5}};
  MapFileWriter writer(path_, kFacts);
  writer.append(blocks().block(0), blocks().voxels(0));
  writer.append_keyframes(std::span(keyframes).first(2));
  writer.append_keyframes(std::span(keyframes).subspan(2));
  ASSERT_TRUE(writer.finish().ok());
  const Result<MapFile> read = read_map_file(path_);
  ASSERT_TRUE(read.ok()) << read.error().message;
  EXPECT_EQ(read.value().blocks->size(), 1);
  EXPECT_TRUE(std::ranges::equal(read.value().keyframes, keyframes));
}

TEST_F(MapFiles, a_resumed_map_is_the_same_and_goes_on) {
  write();
  const Result<MapFile> read = read_map_file(path_);
  ASSERT_TRUE(read.ok());
  MapUnderTest resumed(test::small_camera());
  ASSERT_TRUE(resumed.map().load(*read.value().blocks).empty());
  EXPECT_EQ(test::bytes_of(resumed.map()), test::bytes_of(map_.map()));
  const MapQueries queries(resumed.map(), true);
  int occupied = 0;
  for (double x = -3; x < 3; x += 0.05) {
    const Vec3 p{x, 0.1, 2.98};
    ASSERT_EQ(queries.at(p), map_.map().at(p));
    occupied += queries.at(p) == Occupancy::Occupied;
  }
  EXPECT_GT(occupied, 5);
  for (int i = 0; i < resumed.map().blocks().size(); ++i) {
    for (const Voxel& v : resumed.map().blocks().voxels(i))
      ASSERT_EQ(v.last_hit, 0) << "the mark of another run";
  }
  // A place that was known is cleared as if it had never been interrupted.
  resumed.see(test::wall(3.5), {}, 8);
  EXPECT_EQ(resumed.map().at({0.05, 0.05, 2.98}), Occupancy::Free);
}

TEST_F(MapFiles, a_map_with_too_little_room_loads_what_is_nearest_and_names_the_rest) {
  Config::Map config;
  config.capacity_voxels = 20 * kBlockVoxels;
  MapUnderTest small(test::small_camera(), config);
  const Vec3 around{2.9, 0, 2.9};
  const std::vector<int> rest = small.map().load(blocks(), around);
  EXPECT_EQ(small.map().blocks().blocks_used(), 20u);
  EXPECT_EQ(rest.size(), static_cast<std::size_t>(blocks().size()) - 20);
  const auto distance = [&](const Block& b) {
    return distance2(b.at, block_of(voxel_at(1 / config.voxel_m * around)));
  };
  std::int64_t farthest = 0;
  for (int i = 0; i < 20; ++i) farthest = std::max(farthest, distance(small.map().blocks().block(i)));
  for (const int i : rest) EXPECT_GE(distance(blocks().block(i)), farthest);
}

TEST_F(MapFiles, of_a_block_that_comes_twice_the_newer_look_counts_and_the_older_fills_in) {
  std::array<Voxel, kBlockVoxels> older{}, newer{};
  older[0].log_odds = older[1].log_odds = 100;
  newer[0].log_odds = -64;
  newer[2].log_odds = 90;
  for (const bool newer_first : {true, false}) {
    MapFileWriter writer(path_, kFacts);
    for (const bool is_newer : {newer_first, !newer_first}) {
      Block block;
      block.fused_sequence = is_newer ? 9 : 2;
      writer.append(block, is_newer ? newer : older);
    }
    ASSERT_TRUE(writer.finish().ok());
    const Result<MapFile> read = read_map_file(path_);
    ASSERT_TRUE(read.ok());
    const BlockTable& table = *read.value().blocks;
    ASSERT_EQ(table.blocks_used(), 1u);
    EXPECT_EQ(table.voxels(0)[0].log_odds, -64);
    EXPECT_EQ(table.voxels(0)[1].log_odds, 100);
    EXPECT_EQ(table.voxels(0)[2].log_odds, 90);
    EXPECT_EQ(table.block(0).fused_sequence, 9u);
    EXPECT_EQ(table.block(0).occupied, 2);
  }
}

TEST_F(MapFiles, calibrations_differ_by_their_numbers) {
  const CameraModel camera = test::small_camera();
  CameraModel moved = camera;
  moved.k3 = 1e-9;
  EXPECT_EQ(calibration_hash(camera), calibration_hash(test::small_camera()));
  EXPECT_NE(calibration_hash(camera), calibration_hash(moved));
}

TEST_F(MapFiles, a_copier_hands_over_all_blocks_in_bounded_bites) {
  Arena arena(MapCopier::kBlocksAtOnce * sizeof(CopiedBlock) + 4096);
  MapCopier copier(arena);
  copier.serve(blocks());
  EXPECT_TRUE(copier.ready().items.empty()) << "nobody asked";
  copier.begin();
  std::size_t seen = 0;
  for (bool last = false; !last; copier.next()) {
    EXPECT_TRUE(copier.ready().items.empty());
    copier.serve(blocks());
    const MapCopier::Part copies = copier.ready();
    copier.serve(blocks());  // what is being read is left alone
    for (const CopiedBlock& copy : copies.items) {
      const int index = static_cast<int>(seen++);
      ASSERT_EQ(copy.block.at, blocks().block(index).at);
      ASSERT_EQ(std::memcmp(copy.voxels.data(), blocks().voxels(index).data(), sizeof(copy.voxels)), 0);
    }
    last = copies.last;
    EXPECT_EQ(last, seen == static_cast<std::size_t>(blocks().size()));
  }
  EXPECT_GT(seen, MapCopier::kBlocksAtOnce) << "the map is too small to tell";
  copier.serve(blocks());
  EXPECT_TRUE(copier.ready().items.empty()) << "the pass is over";
}

}  // namespace
}  // namespace stillmap
