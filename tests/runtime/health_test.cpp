// SPDX-License-Identifier: Apache-2.0
#include "runtime/health.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <unistd.h>

#include <nlohmann/json.hpp>
#include <regex>

#include "tests/runtime/pipeline.h"
#include "tests/runtime/service_manager.h"

namespace stillmap {
namespace {

using nlohmann::json;
using test::Pipeline;
using test::wall_driver;
using test::wall_frames;
using ::testing::HasSubstr;

/// The body of `path`, served from this thread.
std::string get(StreamServer& server, const std::string& path) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(server.port()));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof(to));
  const std::string request = "GET " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n";
  std::string answer;
  bool sent = false;
  for (int i = 0; i < 5000; ++i) {
    server.service(0);
    sent = sent || send(fd, request.data(), request.size(), MSG_NOSIGNAL) > 0;
    char buffer[4096];
    const ssize_t bytes = read(fd, buffer, sizeof(buffer));
    if (bytes == 0) break;
    if (bytes > 0) answer.append(buffer, static_cast<std::size_t>(bytes));
    if (bytes < 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  close(fd);
  const std::size_t body = answer.find("\r\n\r\n");
  return body == std::string::npos ? answer : answer.substr(body + 4);
}

Config streaming() {
  Config config = test::WallScene::config();
  config.stream.listen = "127.0.0.1:0";
  return config;
}

TEST(Health, ALockstepRunLeavesWhatHttpAnswers) {
  auto grabs = wall_frames(8);
  grabs[3].status = GrabStatus::Dropped;
  auto driver = wall_driver(true, grabs);
  Pipeline pipeline(driver, {}, false, streaming());
  StreamServer& server = *pipeline.stages->stream;
  ASSERT_TRUE(server.open().ok());
  EXPECT_THAT(get(server, "/health"), HasSubstr("starting"));
  run_lockstep(*pipeline.context);
  Health health(*pipeline.context);
  health.tick();

  const json h = json::parse(get(server, "/health"));
  EXPECT_EQ(h["state"], "tracking");
  EXPECT_EQ(h["frames"]["offered"], 8);
  EXPECT_EQ(h["frames"]["processed"], 7);
  EXPECT_EQ(h["frames"]["dropped"], 1);
  EXPECT_GT(h["rss_kb"], 1000);

  const std::string metrics = get(server, "/metrics");
  EXPECT_THAT(metrics, HasSubstr("\nstillmap_frames_offered_total 8\n"));
  EXPECT_THAT(metrics, HasSubstr("\nstillmap_frames_dropped_total{reason=\"corrupt_colour\"} 1\n"));
  for (const char* pool : {"frames", "points", "keyframes", "map_blocks"}) {
    EXPECT_THAT(metrics, HasSubstr("\nstillmap_pool_high_water{pool=\"" + std::string(pool) + "\"} "));
    EXPECT_THAT(metrics, HasSubstr("\nstillmap_pool_capacity{pool=\"" + std::string(pool) + "\"} "));
  }
  // Prometheus's text format: each line is a type or one sample of a series that a type came before.
  const std::regex type("# TYPE ([a-z_]+) (counter|gauge)"),
      sample("([a-z_]+)(\\{[a-z]+=\"[a-z_.]+\"\\})? [0-9.e+-]+");
  std::istringstream lines(metrics);
  std::string series;
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    if (std::regex_match(line, match, type)) {
      series = match[1];
    } else {
      ASSERT_TRUE(std::regex_match(line, match, sample)) << line;
      EXPECT_EQ(match[1], series);
    }
  }
  server.stop();
}

TEST(Health, ADoubtAboutDepthNamesTheKeyToMend) {
  auto driver = wall_driver(true, {});
  Pipeline pipeline(driver, {});
  RunContext& context = *pipeline.context;
  context.emit(Stage::Capture, EventCode::DepthScale, 90, 71);
  testing::internal::CaptureStdout();  // where the log goes in a test
  Health(context).tick();
  const std::string words = testing::internal::GetCapturedStdout();
  EXPECT_THAT(words, HasSubstr("capture: depth_scale at frame 90: 71 % of the readings lie outside"));
  EXPECT_THAT(words, HasSubstr("camera.depth_units_per_m = 1000 right?"));
}

TEST(Health, SaysOnceThatDecodingIsSlowerThanTheLog) {
  auto driver = wall_driver(true, {});
  Pipeline pipeline(driver);
  Health health(*pipeline.context);
  testing::internal::CaptureStdout();
  pipeline.context->counters.held_back_ns = 900'000'000;  // a hiccup
  health.tick();
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  pipeline.context->counters.held_back_ns = 1'100'000'000;
  testing::internal::CaptureStdout();
  health.finish();
  health.finish();
  const std::string said = testing::internal::GetCapturedStdout();
  EXPECT_THAT(said, HasSubstr("decoding is slower than the log, which plays at about 0 of its 30 frames/s"));
  EXPECT_EQ(said.find("decoding", said.find("decoding") + 1), std::string::npos);
}

TEST(Health, OfAStageThatIsStuckTheServiceManagerHearsNothing) {
  const test::ServiceManager manager("@stillmap_health_" + std::to_string(getpid()));
  setenv("WATCHDOG_USEC", "4", 1);
  auto driver = wall_driver(true, {});
  Pipeline pipeline(driver, {});
  Watchdog& watchdog = pipeline.context->watchdog;
  Health health(*pipeline.context);
  const std::vector<std::string> alive{"WATCHDOG=1"}, silence;
  health.tick();
  EXPECT_EQ(manager.heard(), alive);
  for (const Stage stage : {Stage::Detect, Stage::Track, Stage::Adjust, Stage::Map, Stage::Stream}) {
    watchdog.begin(stage, monotonic_now() - 11'000'000'000);
    health.tick();
    EXPECT_EQ(manager.heard(), silence) << to_string(stage);
    watchdog.end(stage);
    health.tick();
    EXPECT_EQ(manager.heard(), alive) << to_string(stage);
  }
}

TEST(Health, SpeaksOnceASecondAtMost) {
  auto driver = wall_driver(true, {});
  Pipeline pipeline(driver, {}, false, streaming());
  StreamServer& server = *pipeline.stages->stream;
  ASSERT_TRUE(server.open().ok());
  Health health(*pipeline.context);
  const Nanoseconds begin = monotonic_now();
  health.tick();
  const std::string first = get(server, "/health");
  pipeline.context->counters.processed.store(5);
  health.tick();
  if (monotonic_now() - begin < 1'000'000'000) {
    EXPECT_EQ(get(server, "/health"), first);
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(1050));
  health.tick();
  EXPECT_EQ(json::parse(get(server, "/health"))["frames"]["processed"], 5);
  server.stop();
}

}  // namespace
}  // namespace stillmap
