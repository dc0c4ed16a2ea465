// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_server.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace stillmap {
namespace {

Config stream_config(const std::string& listen = "127.0.0.1:0") {
  Config config;
  config.stream.listen = listen;
  config.camera = {.width = 640, .height = 480, .fx = 500, .fy = 500, .cx = 320, .cy = 240};
  config.classes.names = {"person", "chair"};
  return config;
}

std::size_t planned_bytes() {
  Arena plan;
  const StreamServer server(stream_config(), plan);
  return plan.bytes_planned();
}

int connect_to(int port) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof(to));
  return fd;
}

/// Serves from this thread until `fd` has brought `expected`, as lockstep does. What came is returned.
std::string serve_until(StreamServer& server, int fd, const std::string& expected) {
  std::string received;
  for (int i = 0; i < 2000 && received.find(expected) == std::string::npos; ++i) {
    server.service(0);
    char buffer[65536];
    const ssize_t bytes = read(fd, buffer, sizeof(buffer));
    if (bytes > 0) received.append(buffer, static_cast<std::size_t>(bytes));
    if (bytes <= 0) usleep(500);
  }
  return received;
}

/// Serves until the other side has closed `fd`, or for a second. What came is returned.
std::string all_until_closed(StreamServer& server, int fd) {
  std::string received;
  for (int i = 0; i < 2000; ++i) {
    server.service(0);
    char buffer[65536];
    const ssize_t bytes = read(fd, buffer, sizeof(buffer));
    if (bytes == 0 || (bytes < 0 && errno == ECONNRESET)) return received;
    if (bytes > 0) received.append(buffer, static_cast<std::size_t>(bytes));
    if (bytes < 0) usleep(500);
  }
  return received + " and was not closed";
}

void send_all(int fd, const std::string& text) {
  for (int i = 0; i < 2000 && send(fd, text.data(), text.size(), MSG_NOSIGNAL) < 0; ++i) usleep(500);
}

std::string shake_hands(StreamServer& server, int fd) {
  send_all(
      fd,
      "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: "
      "Upgrade\r\nSec-WebSocket-Version: "
      "13\r\n"
      "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.websocket.v1\r\n\r\n");
  return serve_until(server, fd, "foxglove.Log");
}

void send_message(int fd, const std::string& text) {
  ASSERT_LT(text.size(), 126U);
  std::string frame = {'\x81', static_cast<char>(0x80 | text.size()), 0, 0, 0, 0};  // masked by zeros
  send_all(fd, frame += text);
}

TEST(StreamServer, PlansWhatItTakesAndOpensNothingWhilePlanning) {
  const std::size_t bytes = planned_bytes();
  EXPECT_GT(bytes, kMaxCloudPoints * sizeof(CloudPoint));
  EXPECT_LT(bytes, kMaxCloudPoints * sizeof(CloudPoint) + 2'000'000);
  Arena arena(bytes);
  const StreamServer server(stream_config(), arena);
  EXPECT_EQ(arena.bytes_planned(), bytes);
}

TEST(StreamServer, ListensOnAnyFreePortAndSaysWhenOneIsTaken) {
  Arena arena(planned_bytes()), other_arena(planned_bytes());
  StreamServer server(stream_config(), arena);
  ASSERT_TRUE(server.open().ok());
  ASSERT_GT(server.port(), 0);
  StreamServer other(stream_config("127.0.0.1:" + std::to_string(server.port())), other_arena);
  const Status status = other.open();
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().exit_code, ExitCode::RunFailed);
  EXPECT_NE(status.error().message.find("in use"), std::string::npos);
}

TEST(StreamServer, RefusesAWrongAddress) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config("here"), arena);
  const Status status = server.open();
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().exit_code, ExitCode::WrongConfig);
}

TEST(StreamServer, ListensOnIpv6) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config("[::1]:0"), arena);
  const Status status = server.open();
  if (!status.ok()) GTEST_SKIP() << "no IPv6 here: " << status.error().message;
  EXPECT_GT(server.port(), 0);
}

TEST(StreamServer, ServiceReturnsWhenItSays) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config(), arena);
  ASSERT_TRUE(server.open().ok());
  server.service(1);
  Nanoseconds start = monotonic_now();
  for (int i = 0; i < 100; ++i) server.service(0);  // a tenth of a second each, if it waited
  EXPECT_LT(to_ms(monotonic_now() - start), 9000);
  start = monotonic_now();
  server.service(100);
  EXPECT_GT(to_ms(monotonic_now() - start), 90);
  EXPECT_LT(to_ms(monotonic_now() - start), 9000);
}

TEST(StreamServer, ServesHttpAndWebSocketFromOneThread) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config(), arena);
  ASSERT_TRUE(server.open().ok());
  ASSERT_TRUE(server.publish_health({}, "{\"state\":\"lost\"}", "x 1\n"));
  const int http = connect_to(server.port());
  send_all(http, "GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n");
  EXPECT_NE(serve_until(server, http, "lost").find("HTTP/1.1 200"), std::string::npos);
  close(http);

  const int client = connect_to(server.port());
  const std::string greeting = shake_hands(server, client);
  EXPECT_NE(greeting.find("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), std::string::npos);
  EXPECT_NE(greeting.find("foxglove.PointCloud"), std::string::npos);
  EXPECT_EQ(server.stats().clients, 1U);
  const std::optional<Event> came = server.events().try_pop();
  ASSERT_TRUE(came.has_value());
  EXPECT_EQ(came->code, EventCode::ClientConnected);
  EXPECT_EQ(came->a, 1);

  EXPECT_FALSE(server.cloud_wanted());
  send_message(client,
               R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":3},{"id":2,"channelId":2}]})");
  for (int i = 0; i < 2000 && !server.cloud_wanted(); ++i) {
    server.service(0);
    usleep(500);
  }
  ASSERT_TRUE(server.cloud_wanted());
  const std::span<CloudPoint> points = server.begin_cloud();
  ASSERT_EQ(points.size(), kMaxCloudPoints);
  points[0].x = 1;
  const Nanoseconds before_the_cloud = monotonic_now();
  server.publish_cloud(1, 5, 0);
  server.publish_pose({.stamp_ns = 6});
  EXPECT_NE(serve_until(server, client, std::string("\x02\0\0\0\x06", 5)).find("alpha"), std::string::npos);
  const bool again = server.cloud_wanted();
  if (monotonic_now() - before_the_cloud < 1'000'000'000) {
    EXPECT_FALSE(again);
  }
  EXPECT_EQ(server.stats().messages_sent, 11U + 2U);  // the greeting, and a cloud and a pose

  close(client);
  for (int i = 0; i < 2000 && server.stats().clients > 0; ++i) server.service(1);
  EXPECT_EQ(server.stats().clients, 0U);
  EXPECT_EQ(server.stats().clients_peak, 1U);
  server.stop();
}

TEST(StreamServer, AConnectionIsAnsweredOnceAndCannotAskForAnUpgradeThen) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config(), arena);
  ASSERT_TRUE(server.open().ok());
  const int http = connect_to(server.port());
  send_all(http,
           "GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: "
           "no\r\n\r\n");
  const std::string answered = serve_until(server, http, "starting");
  EXPECT_NE(answered.find("connection: close"), std::string::npos);
  EXPECT_EQ(answered.find("keep-alive"), std::string::npos);
  EXPECT_EQ(answered.find("HTTP/1.1", 1), std::string::npos) << answered;
  EXPECT_EQ(all_until_closed(server, http), "");
  close(http);
}

TEST(StreamServer, NoUpgradeIsGivenButToWebSocket) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config(), arena);
  ASSERT_TRUE(server.open().ok());
  const int http = connect_to(server.port());
  send_all(http,
           "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\n"
           "HTTP2-Settings: AAMAAABkAARAAAAAAAIAAAAA\r\n\r\n");
  EXPECT_EQ(all_until_closed(server, http), "");
  close(http);
}

TEST(StreamServer, AClientThatStopsReadingMissesPosesAndGoesOnWithTheNewest) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config(), arena);
  ASSERT_TRUE(server.open().ok());
  const int client = connect_to(server.port());
  shake_hands(server, client);
  send_message(client, R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]})");
  constexpr int kPoses = 50'000;  // more than the kernel holds for both sides
  for (int i = 1; i <= kPoses; ++i) {
    server.publish_pose({.stamp_ns = i});
    server.service(0);
  }
  const StreamStats stats = server.stats();
  EXPECT_GT(stats.messages_dropped, kPoses / 2);
  EXPECT_LE(stats.messages_dropped + stats.messages_sent, kPoses + 11U);  // 11: the greeting
  EXPECT_GE(stats.messages_dropped + stats.messages_sent + 32, kPoses);
  const Nanoseconds last = kPoses;
  std::string stamp(sizeof(last), '\0');
  std::memcpy(stamp.data(), &last, sizeof(last));
  EXPECT_NE(serve_until(server, client, stamp).find(stamp), std::string::npos);
  close(client);
}

TEST(StreamServer, PosesThatNobodyServesAreCountedNotKept) {
  Arena arena(planned_bytes());
  StreamServer server(stream_config(), arena);
  ASSERT_TRUE(server.open().ok());
  for (int i = 0; i < 100; ++i) server.publish_pose({.stamp_ns = i});
  EXPECT_EQ(server.stats().poses_refused, 36U);
}

}  // namespace
}  // namespace stillmap
