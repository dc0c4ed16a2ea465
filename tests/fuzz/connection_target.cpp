// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <string_view>

#include "stream/stream_server.h"
#include "tests/fuzz/targets.h"

namespace stillmap::fuzz {

namespace {

Config config() {
  Config config;
  config.stream.listen = "127.0.0.1:0";
  config.camera = {.width = 640, .height = 480, .fx = 500, .fy = 500, .cx = 320, .cy = 240};
  config.classes.names = {"person"};
  return config;
}

/// Listens for as long as the process lives.
struct Server {
  Server() { require(server.open().ok() && server.publish_health({}, "{\"state\":\"lost\"}", "x 1\n")); }
  static std::size_t planned_bytes() {
    Arena plan;
    const StreamServer planned(config(), plan);
    return plan.bytes_planned();
  }
  Arena arena{planned_bytes()};
  StreamServer server{config(), arena};
};

class Connection {
 public:
  explicit Connection(int port) {
    for (int tries = 0; !reach(port); ++tries) {
      require(tries < 100);
      usleep(20'000);
    }
    constexpr linger kReset{1, 0};
    require(setsockopt(socket_, SOL_SOCKET, SO_LINGER, &kReset, sizeof(kReset)) == 0);
  }
  ~Connection() { close(socket_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// What is not taken is left out.
  void send(const void* data, std::size_t bytes) const {
    static_cast<void>(::send(socket_, data, bytes, MSG_NOSIGNAL | MSG_DONTWAIT));
  }
  std::string_view receive() {
    const ssize_t bytes = recv(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT);
    return {buffer_.data(), static_cast<std::size_t>(bytes > 0 ? bytes : 0)};
  }

 private:
  bool reach(int port) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    // Each from an address of its own: what was closed keeps its port for a minute, and there are too few.
    static std::uint32_t connections = 0;
    sockaddr_in from{};
    from.sin_family = AF_INET;
    from.sin_addr.s_addr = htonl(INADDR_LOOPBACK + connections++ % 1'000'000);
    socket_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (bind(socket_, reinterpret_cast<const sockaddr*>(&from), sizeof(from)) == 0 &&
        connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) == 0)
      return true;
    close(socket_);
    return false;
  }

  int socket_ = -1;
  std::array<char, 65536> buffer_{};
};

}  // namespace

void serve_connection(Bytes bytes) {
  static Server served;
  StreamServer& server = served.server;
  {
    Connection stranger(server.port());
    // Two pieces, so that the second comes when the first has been answered.
    const std::size_t first = bytes.empty() ? 0 : bytes.size() - bytes.size() / 4;
    for (const Bytes piece : {bytes.first(first), bytes.subspan(first)}) {
      stranger.send(piece.data(), piece.size());
      for (int round = 0; round < 4; ++round) {
        server.service(0);
        static_cast<void>(stranger.receive());
      }
    }
  }
  for (int round = 0; round < 1000 && server.stats().clients > 0; ++round) server.service(0);
  require(server.stats().clients == 0);
  while (server.events().try_pop()) continue;
  // Whatever it was, the next one is served.
  constexpr std::string_view kRequest = "GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
  Connection next(server.port());
  next.send(kRequest.data(), kRequest.size());
  std::string_view answer;
  for (int round = 0; round < 1000 && answer.empty(); ++round) {
    server.service(0);
    answer = next.receive();
  }
  require(answer.starts_with("HTTP/1.1 200"));
}

}  // namespace stillmap::fuzz
