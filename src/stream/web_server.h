// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "core/arena.h"
#include "core/event.h"
#include "core/status.h"
#include "stream/access.h"
#include "stream/client_session.h"
#include "stream/counters.h"
#include "stream/http_content.h"

struct lws;
struct lws_context;
struct lws_vhost;
struct lws_sorted_usec_list;

namespace stillmap::stream {

/// The sockets: carries sessions over WebSocket and the HTTP content on one port with libwebsockets. Stream
/// thread.
class WebServer {
 public:
  WebServer(const Config::Stream& config, Arena& arena, Feed& feed, HttpContent& content, Counters& counters,
            EventRing& events);
  ~WebServer();
  WebServer(const WebServer&) = delete;
  WebServer& operator=(const WebServer&) = delete;

  Status open();
  int port() const;
  /// One round: what is due goes out, what came in is answered; see StreamServer::service.
  void service(int timeout_ms);
  void stop();
  /// Stream thread. Whether any client is.
  bool subscribed(Channel channel) const;
  /// Map thread. Each client's.
  std::span<BlockExchange> block_exchanges() const { return block_exchanges_; }
  /// Any thread. Ends the wait of `service`.
  void wake();

 private:
  /// A place for one client. `socket` is null while it is free.
  struct Slot {
    lws* socket = nullptr;
    bool given_up = false;  ///< closing; gets nothing more
    ClientSession session;
  };
  /// What libwebsockets keeps for each connection of ours.
  struct Connection {
    Slot* slot;  ///< null for HTTP and for clients that were refused
  };
  struct Callback;  ///< the library's calls to us

  Status create_context(const ListenAddress& address);
  void give_up_on_the_intolerable();
  void manage_cloud();
  void pass_cloud_turn();
  int accept(lws* socket, Connection& connection);
  void forget(Connection& connection);
  void receive(Slot& slot, std::string_view piece);
  int write(Slot& slot);
  Access::Verdict judge(lws* socket, bool web_socket);
  int filter(lws* socket);
  void answer(lws* socket, std::string_view path);
  void reply(lws* socket, const HttpReply& reply);
  void emit(EventCode code);

  const Config::Stream config_;
  const std::span<Slot> slots_;
  const std::span<BlockExchange> block_exchanges_;  ///< of the slots, in their order
  const std::span<std::uint8_t> scratch_;           ///< room for the library's header, then one chunk
  Feed& feed_;
  HttpContent& content_;
  Counters& counters_;
  EventRing& events_;

  Access access_;
  lws_context* context_ = nullptr;
  lws_vhost* vhost_ = nullptr;
  std::unique_ptr<lws_sorted_usec_list> timer_;
  bool stopping_ = false;
  std::uint64_t cloud_seen_ = 0;  ///< generation
  Nanoseconds cloud_seen_ns_ = 0;
};

}  // namespace stillmap::stream
