// SPDX-License-Identifier: Apache-2.0
// Serves known poses and clouds to client_test.mjs. Prints its port, then obeys lines on its input: `stats`
// prints counters as JSON, `freeze` and `thaw` stop and restart changes of the map, `quit` (or the end of
// input) stops.
#include <libwebsockets.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <string>
#include <thread>
#include <utility>

#include "stream/stream_server.h"

namespace {

using namespace stillmap;

std::atomic<bool> running{true}, frozen{false};
bool clock_stamps = false;  // poses carry the moment they are published at
std::atomic<std::uint64_t> library_allocations{0};

void* counting_realloc(void* memory, std::size_t bytes, const char*) {
  if (bytes == 0) {
    std::free(memory);
    return nullptr;
  }
  ++library_allocations;
  return std::realloc(memory, bytes);
}

constexpr std::uint32_t kMapEpoch = 4;

StreamPose pose_at(std::int64_t i) {
  StreamPose pose;
  pose.stamp_ns = 1'700'000'000'000'000'000 + i * 10'000'000;
  pose.T_map_odom = {rotation_from({.w = std::sqrt(0.5), .z = std::sqrt(0.5)}), {1, 2, 3}};
  pose.T_odom_base.t = {0.01 * static_cast<double>(i), 0, 0};
  pose.T_base_camera.t = {0, 0, 0.5};
  pose.epoch = kMapEpoch + 1;  // the map is still at it
  return pose;
}

/// A picture that is red where a person's face would be, and a person in the box around it.
constexpr Box kPersonBox{200, 100, 400, 420};

Detections person() {
  Detections found;
  static_cast<void>(
      found.items.try_push_back({.box = kPersonBox, .kind = ClassKind::Dynamic, .score = 0.9F}));
  return found;
}

void paint(FrameSlot& frame) {
  for (int y = 0; y < frame.colour.height; ++y) {
    for (int x = 0; x < frame.colour.width; ++x) {
      const bool stripe = x / 4 % 2 == 0;
      const auto bright = static_cast<std::uint8_t>(stripe ? 250 : 5);
      frame.colour.at(x, y) = {bright, bright, bright};
    }
  }
}

StreamScene scene_at(std::int64_t i) {
  StreamScene scene;
  scene.sequence = static_cast<std::uint64_t>(i);
  scene.stamp_ns = pose_at(i).stamp_ns;
  scene.has_pose = true;
  const StreamObject walker{.id = 7,
                            .class_id = 0,
                            .kind = ClassKind::Dynamic,
                            .score = 0.9F,
                            .box = kPersonBox,
                            .near_m = 2,
                            .far_m = 2.5F,
                            .velocity_m_s = {1, 0, 0},
                            .age_ns = 1'500'000'000};
  static_cast<void>(scene.objects.try_push_back(walker));
  for (const Label label : {Label::Static, Label::Dynamic, Label::SemiStatic, Label::Unknown})
    static_cast<void>(scene.features.try_push_back({100, 200, label}));
  return scene;
}

/// Poses every 10 ms, and what the runtime does with them: scenes and pictures where they are wanted.
void track(StreamServer& server, FramePool& frames) {
  for (std::int64_t i = 0; running; ++i) {
    StreamPose pose = pose_at(i);
    if (clock_stamps) {
      pose.stamp_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(
                          std::chrono::system_clock::now().time_since_epoch())
                          .count();
    }
    server.publish_pose(pose);
    if (server.scene_wanted()) server.publish_scene(scene_at(i));
    if (server.picture_wanted()) {
      FrameHandle frame = frames.acquire();
      if (frame) {
        frame.writable().sequence = static_cast<std::uint64_t>(i);
        frame.writable().colour_ns = pose_at(i).stamp_ns;
        paint(frame.writable());
        server.publish_picture(*frame, person());
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

/// A map of some blocks in a row, of which one changes all the time: it loses a voxel, then gets it back.
struct Blocks {
  int count;
  std::uint64_t version = 1;

  StreamBlock block(std::uint32_t slot) const {
    StreamBlock block{.slot = slot,
                      .x = static_cast<std::int32_t>(slot % 100) - 50,
                      .y = static_cast<std::int32_t>(slot / 100),
                      .z = -1};
    // A floor one voxel thick.
    for (std::size_t v = 0; v < 64; ++v) {
      block.occupied[v / 8] = 255;
      block.colours[3 * v] = static_cast<std::uint8_t>(slot);
      block.colours[3 * v + 1] = static_cast<std::uint8_t>(slot >> 8);
      block.colours[3 * v + 2] = 200;
    }
    block.count = 64;
    if (slot == 1 && version % 2 == 1) block = {.slot = slot, .x = block.x, .y = block.y, .z = block.z};
    return block;
  }
  void answer(StreamServer& server) {
    if (!frozen) ++version;
    for (stream::BlockExchange& exchange : server.block_exchanges()) {
      if (!exchange.begin()) continue;
      std::uint32_t slot = exchange.request().cursor;
      const auto end = static_cast<std::uint32_t>(count);
      for (; slot < end; ++slot) {
        const bool changed =
            exchange.request().since == 0 || (slot == 1 && version > exchange.request().since);
        if (changed && !exchange.add(block(slot))) break;
      }
      exchange.finish({slot, slot == end, version, kMapEpoch, 0.04, 42});
    }
    server.blocks_answered();
  }
};

void map(StreamServer& server, int block_count) {
  Blocks blocks{block_count};
  for (std::int64_t generation = 1; running;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    blocks.answer(server);
    if (frozen || !server.cloud_wanted()) continue;
    const std::span<CloudPoint> points = server.begin_cloud();
    if (points.empty()) continue;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const auto byte = [k](int shift) { return static_cast<std::uint8_t>(k >> shift); };
      points[k] = {.x = 0.001F * static_cast<float>(k),
                   .y = -static_cast<float>(k),
                   .z = static_cast<float>(generation),
                   .r = byte(0),
                   .g = byte(8),
                   .b = byte(16),
                   .a = 255};
    }
    server.publish_cloud(points.size(), generation * 1'000'000'000 + 7, kMapEpoch);
    ++generation;
  }
}

void print_stats(const StreamServer& server) {
  const StreamStats s = server.stats();
  const std::pair<const char*, std::uint64_t> counts[] = {{"clients", s.clients},
                                                          {"peak", s.clients_peak},
                                                          {"refused", s.clients_refused},
                                                          {"given_up", s.clients_given_up},
                                                          {"sent", s.messages_sent},
                                                          {"dropped", s.messages_dropped},
                                                          {"bytes", s.bytes_sent},
                                                          {"bad", s.bad_messages},
                                                          {"unwelcome", s.clients_unwelcome},
                                                          {"pictures", s.pictures_sent},
                                                          {"withheld", s.pictures_withheld},
                                                          {"poses_refused", s.poses_refused},
                                                          {"allocations", library_allocations.load()}};
  char before = '{';
  for (const auto& [name, count] : counts) {
    std::cout << before << '"' << name << "\":" << count;
    before = ',';
  }
  std::cout << "}\n";
}

}  // namespace

int main(int argc, char** argv) {
  setvbuf(stdout, nullptr, _IOLBF, 0);
  lws_set_allocator(counting_realloc);
  Config config;
  config.stream.listen = "127.0.0.1:0";
  config.camera = {.width = 640, .height = 480, .fx = 500, .fy = 500, .cx = 320, .cy = 240};
  config.classes.names = {"person"};
  int blocks = 300;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string option = argv[i], value = argv[i + 1];
    if (option == "--listen") config.stream.listen = value;
    if (option == "--token") config.stream.token_file = value;
    if (option == "--preview") config.stream.preview = value;
    if (option == "--certificate") config.stream.tls_certificate = value;
    if (option == "--key") config.stream.tls_key = value;
    if (option == "--blocks") blocks = std::stoi(value);
    if (option == "--stamps") clock_stamps = value == "clock";
  }
  Arena plan;
  StreamServer planned(config, plan);
  FramePool planned_frames(plan, 2, config.camera.width, config.camera.height);
  Arena arena(plan.bytes_planned());
  FramePool frames(arena, 2, config.camera.width, config.camera.height);
  StreamServer server(config, arena);
  if (const Status opened = server.open(); !opened.ok()) {
    std::fprintf(stderr, "%s\n", opened.error().message.c_str());
    return 1;
  }
  std::printf("%d\n", server.port());
  if (!server.publish_health({.state = "tracking", .fps = 29.5, .latency_ms = 12.5, .rss_bytes = 96000000},
                             "{\"state\":\"tracking\"}", "stillmap_up 1\n"))
    return 1;

  for (int i = 0; i < 70; ++i) {
    server.publish_log(LogLevel::Warning, "track", "line " + std::to_string(i));
    server.service(0);
  }
  std::thread tracker(track, std::ref(server), std::ref(frames)), mapper(map, std::ref(server), blocks);
  std::thread streamer([&] {
    while (running) server.service(20);
    server.stop();
  });
  for (std::string line; std::getline(std::cin, line) && line != "quit";) {
    if (line == "stats") print_stats(server);
    if (line == "freeze") frozen = true;
    if (line == "thaw") frozen = false;
  }
  running = false;
  tracker.join();
  mapper.join();
  streamer.join();
  print_stats(server);
  return 0;
}
