// SPDX-License-Identifier: Apache-2.0
// Serves known poses and clouds to client_test.mjs. Prints its port, then obeys lines on its input: `stats`
// prints counters as JSON, `freeze` and `thaw` stop and restart changes of the map, `quit` (or the end of
// input) stops.
#include <libwebsockets.h>

#include <atomic>
#include <cstdio>
#include <iostream>
#include <string>
#include <thread>

#include "stream/stream_server.h"

namespace {

using namespace stillmap;

std::atomic<bool> running{true}, frozen{false};
std::atomic<std::uint64_t> library_allocations{0};

void* counting_realloc(void* memory, std::size_t bytes, const char*) {
  if (bytes == 0) {
    std::free(memory);
    return nullptr;
  }
  ++library_allocations;
  return std::realloc(memory, bytes);
}

StreamPose pose_at(std::int64_t i) {
  StreamPose pose;
  pose.stamp_ns = 1'700'000'000'000'000'000 + i * 10'000'000;
  pose.T_map_odom = {rotation_from({.w = std::sqrt(0.5), .z = std::sqrt(0.5)}), {1, 2, 3}};
  pose.T_odom_base.t = {0.01 * static_cast<double>(i), 0, 0};
  pose.T_base_camera.t = {0, 0, 0.5};
  return pose;
}

void track(StreamServer& server) {
  for (std::int64_t i = 0; running; ++i) {
    server.publish_pose(pose_at(i));
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

void map(StreamServer& server) {
  for (std::int64_t generation = 1; running;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
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
    server.publish_cloud(points.size(), generation * 1'000'000'000 + 7);
    ++generation;
  }
}

void print_stats(const StreamServer& server) {
  const StreamStats s = server.stats();
  std::printf(
      "{\"clients\":%lu,\"peak\":%lu,\"refused\":%lu,\"given_up\":%lu,\"sent\":%lu,\"dropped\":%lu,"
      "\"bytes\":%lu,\"bad\":%lu,\"allocations\":%lu}\n",
      s.clients, s.clients_peak, s.clients_refused, s.clients_given_up, s.messages_sent, s.messages_dropped,
      s.bytes_sent, s.bad_messages, library_allocations.load());
}

}  // namespace

int main() {
  setvbuf(stdout, nullptr, _IOLBF, 0);
  lws_set_allocator(counting_realloc);
  Config::Stream config;
  config.listen = "127.0.0.1:0";
  Arena plan;
  StreamServer planned(config, plan);
  Arena arena(plan.bytes_planned());
  StreamServer server(config, arena);
  if (const Status opened = server.open(); !opened.ok()) {
    std::fprintf(stderr, "%s\n", opened.error().message.c_str());
    return 1;
  }
  std::printf("%d\n", server.port());
  if (!server.publish_health("{\"state\":\"tracking\"}", "stillmap_up 1\n")) return 1;

  std::thread tracker(track, std::ref(server)), mapper(map, std::ref(server));
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
