// SPDX-License-Identifier: Apache-2.0
#include "stream/web_server.h"

#include <libwebsockets.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>

#include "stream/listen_address.h"

namespace stillmap::stream {
namespace {

constexpr std::size_t kReceiveBytes = 1024;         // a longer message comes in pieces
constexpr std::size_t kBytesPerRound = 240 * 1024;  // for one client, before the others have their turn
// The kernel's buffers for each client: room for a chunk whole whenever it takes any, and no more unsent than
// that, or a slow client's poses would grow old there.
constexpr int kSendBufferBytes = 192 * 1024, kUnsentBytes = kChunkBytes;
constexpr Nanoseconds kCloudInterval_ns = 1'000'000'000;
constexpr Nanoseconds kFarewell_ns = 500'000'000;
constexpr int kOtherSockets = 24;  // besides WebSocket clients: HTTP requests, listening, waking
constexpr int kTryAgainLater = 1013;
constexpr char kEnding[] = "the robot's runtime is ending";

// A peer that has vanished, or reads nothing at all, answers no ping and gives its place back.
constexpr lws_retry_bo_t kIdlePolicy = {nullptr, 0, 0, 20, 40, 0};

int close_with(lws* socket, int code, std::string_view reason) {
  std::array<unsigned char, 123> text{};  // what a close frame holds
  const std::size_t bytes = std::min(reason.size(), text.size());
  std::memcpy(text.data(), reason.data(), bytes);
  lws_close_reason(socket, static_cast<lws_close_status>(code), text.data(), bytes);
  return -1;
}

}  // namespace

struct WebServer::Callback {
  static int on_event(lws* socket, lws_callback_reasons reason, void* user, void* in, std::size_t bytes) {
    auto* server = static_cast<WebServer*>(lws_context_user(lws_get_context(socket)));
    auto* connection = static_cast<Connection*>(user);
    switch (reason) {
      case LWS_CALLBACK_HTTP:
        server->answer(socket, {static_cast<const char*>(in), bytes});
        // One answer a connection, which ends when that is sent: of a second request, one for an upgrade that
        // the library (4.1) does not know, it would read headers that it has freed.
        return -1;
      case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE:  // to HTTP/2, too, before any token is asked for
        return strcasecmp(static_cast<const char*>(in), "websocket") == 0 ? 0 : -1;
      case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION:
        return server->filter(socket);
      case LWS_CALLBACK_ESTABLISHED:
        return server->accept(socket, *connection);
      case LWS_CALLBACK_RECEIVE:
        if (connection->slot != nullptr)
          server->receive(*connection->slot, {static_cast<const char*>(in), bytes});
        return 0;
      case LWS_CALLBACK_SERVER_WRITEABLE:
        return connection->slot != nullptr ? server->write(*connection->slot) : 0;
      case LWS_CALLBACK_CLOSED:
        server->forget(*connection);
        return 0;
      default:
        return lws_callback_http_dummy(socket, reason, user, in, bytes);
    }
  }
  // The last field is how much the library hands to the kernel at once; of more it would keep a copy on the
  // heap. One callback for all: HTTP comes to the first entry, as does a WebSocket client that names no
  // subprotocol.
  static constexpr lws_protocols kProtocols[] = {
      {"foxglove.sdk.v1", on_event, sizeof(Connection), kReceiveBytes, 0, nullptr, kChunkBytes},
      {"foxglove.websocket.v1", on_event, sizeof(Connection), kReceiveBytes, 0, nullptr, kChunkBytes},
      {nullptr, nullptr, 0, 0, 0, nullptr, 0},
  };
};

WebServer::WebServer(const Config::Stream& config, Arena& arena, Feed& feed, HttpContent& content,
                     Counters& counters, EventRing& events)
    : config_(config),
      slots_(arena.take<Slot>("stream.clients", static_cast<std::size_t>(config.max_clients))),
      block_exchanges_(
          arena.take<BlockExchange>("stream.client_blocks", static_cast<std::size_t>(config.max_clients))),
      scratch_(arena.take<std::uint8_t>("stream.scratch", LWS_PRE + kChunkBytes)),
      feed_(feed),
      content_(content),
      counters_(counters),
      events_(events),
      timer_(std::make_unique<lws_sorted_usec_list>()) {
  constexpr std::size_t kBytes = kMaxPayloadBytes - kMaxBlocksEnvelopeBytes;
  const auto memory = arena.take<std::uint8_t>("stream.client_blocks.bytes",
                                               static_cast<std::size_t>(config.max_clients) * kBytes);
  for (std::size_t i = 0; i < block_exchanges_.size(); ++i)
    block_exchanges_[i].use(memory.subspan(i * kBytes, kBytes));
}

WebServer::~WebServer() {
  if (context_ != nullptr) lws_context_destroy(context_);
}

Status WebServer::open() {
  STILLMAP_CHECK(!slots_.empty() && context_ == nullptr);
  const Result<ListenAddress> address = parse_listen_address(config_.listen);
  if (!address.ok()) return address.error();
  Result<Access> access = Access::open(config_, address.value());
  if (!access.ok()) return access.error();
  access_ = std::move(access.value());
  for (const auto& [key, path] : {std::pair{"stream.tls_certificate", &config_.tls_certificate},
                                  std::pair{"stream.tls_key", &config_.tls_key}}) {
    std::error_code unknown;
    if (!path->empty() &&
        (::access(path->c_str(), R_OK) != 0 || !std::filesystem::is_regular_file(*path, unknown)))
      return Error{ExitCode::WrongConfig,
                   std::string(key) + " = \"" + *path + "\" cannot be read; name a PEM file"};
  }
  if (Status possible = check_can_listen(address.value()); !possible.ok()) return possible;
  return create_context(address.value());
}

Status WebServer::create_context(const ListenAddress& address) {
  lws_set_log_level(0, nullptr);  // its words aren't ours; what matters becomes a Status or a counter
  lws_context_creation_info info{};
  info.options = LWS_SERVER_OPTION_EXPLICIT_VHOSTS | LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND;
  if (!address.ipv6) info.options |= LWS_SERVER_OPTION_DISABLE_IPV6;
  if (!config_.tls_certificate.empty()) {
    info.options |= LWS_SERVER_OPTION_DO_SSL_GLOBAL_INIT;
    info.ssl_cert_filepath = config_.tls_certificate.c_str();
    info.ssl_private_key_filepath = config_.tls_key.c_str();
  }
  info.user = this;
  info.fd_limit_per_thread = static_cast<unsigned>(slots_.size() + kOtherSockets);
  info.port = address.port;
  info.iface = address.host.c_str();
  info.protocols = Callback::kProtocols;
  info.retry_and_idle_policy = &kIdlePolicy;
  info.timeout_secs = 5;
  info.keepalive_timeout = 5;
  info.server_string = "stillmap";
  info.alpn = "http/1.1";  // browsers would take HTTP/2, of which a connection does not end with its answer
  context_ = lws_create_context(&info);
  if (context_ != nullptr) vhost_ = lws_create_vhost(context_, &info);
  if (vhost_ != nullptr) return {};
  // That the address can be listened on was tried before.
  if (!config_.tls_certificate.empty())
    return Error{ExitCode::WrongConfig,
                 "stream.tls_certificate = \"" + config_.tls_certificate + "\" and stream.tls_key = \"" +
                     config_.tls_key +
                     "\" are no pair that OpenSSL takes; name a certificate in PEM and its own key, without "
                     "a password and of 2048 bits or more"};
  return Error{ExitCode::RunFailed, "stream.listen: libwebsockets cannot listen on " + config_.listen +
                                        "; try another port, or off"};
}

int WebServer::port() const {
  return lws_get_vhost_listen_port(vhost_);
}

void WebServer::wake() {
  if (Counters::read(counters_.clients) > 0) lws_cancel_service(context_);
}

bool WebServer::subscribed(Channel channel) const {
  return std::ranges::any_of(slots_, [channel](const Slot& slot) {
    return slot.socket != nullptr && !slot.given_up && slot.session.subscribed(channel);
  });
}

void WebServer::service(int timeout_ms) {
  give_up_on_the_intolerable();
  manage_cloud();
  pass_cloud_turn();
  const Nanoseconds now_ns = monotonic_now();
  for (Slot& slot : slots_) {
    if (slot.socket == nullptr) continue;
    Counters::add(counters_.messages_dropped, slot.session.drop_outdated(feed_));
    slot.session.ask_for_blocks(now_ns);
    if (stopping_ || slot.session.has_pending(feed_)) lws_callback_on_writable(slot.socket);
  }
  // The library takes no timeout of its own (0 is until something happens, less is not at all): a timer wakes
  // it.
  if (timeout_ms > 0) {
    lws_sul_schedule(
        context_, 0, timer_.get(), [](lws_sorted_usec_list_t*) {}, lws_usec_t{timeout_ms} * 1000);
  }
  lws_service(context_, timeout_ms > 0 ? 0 : -1);
}

void WebServer::stop() {
  stopping_ = true;
  const Nanoseconds deadline_ns = monotonic_now() + kFarewell_ns;
  while (Counters::read(counters_.clients) > 0 && monotonic_now() < deadline_ns) service(10);
}

void WebServer::give_up_on_the_intolerable() {
  const Nanoseconds now_ns = monotonic_now();
  for (Slot& slot : slots_) {
    if (slot.socket == nullptr || slot.given_up || !slot.session.intolerable(now_ns)) continue;
    slot.given_up = true;
    Counters::add(counters_.clients_given_up, 1);
    lws_set_timeout(slot.socket, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_SYNC);
  }
}

void WebServer::manage_cloud() {
  CloudExchange& cloud = feed_.cloud;
  const Nanoseconds now_ns = monotonic_now();
  const bool wanted = subscribed(Channel::Map);
  bool owed = false, receiving = false;
  for (const Slot& slot : slots_) {
    if (slot.socket == nullptr || slot.given_up) continue;
    owed = owed || slot.session.owed_cloud(cloud);
    receiving = receiving || slot.session.receiving_cloud();
  }
  if (cloud.generation() != cloud_seen_) {
    cloud_seen_ = cloud.generation();
    cloud_seen_ns_ = now_ns;
  }
  if (owed || !wanted) {
    cloud.reclaim();
  } else if (!receiving && (cloud_seen_ == 0 || now_ns - cloud_seen_ns_ >= kCloudInterval_ns)) {
    cloud.offer();
  }
}

void WebServer::pass_cloud_turn() {
  const Nanoseconds now_ns = monotonic_now();
  feed_.cloud_under_way = std::ranges::any_of(slots_, [now_ns](const Slot& slot) {
    return slot.socket != nullptr && slot.session.has_cloud_turn(now_ns);
  });
}

int WebServer::accept(lws* socket, Connection& connection) {
  connection.slot = nullptr;
  if (stopping_) return close_with(socket, LWS_CLOSE_STATUS_GOINGAWAY, kEnding);
  for (Slot& slot : slots_) {
    if (slot.socket != nullptr) continue;
    connection.slot = &slot;
    slot.socket = socket;
    slot.given_up = false;
    slot.session.reset(block_exchanges_[static_cast<std::size_t>(&slot - slots_.data())]);
    const int fd = lws_get_socket_fd(socket);
    setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &kSendBufferBytes, sizeof(kSendBufferBytes));
    setsockopt(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &kUnsentBytes, sizeof(kUnsentBytes));
    counters_.client_came();
    emit(EventCode::ClientConnected);
    lws_callback_on_writable(socket);
    return 0;
  }
  Counters::add(counters_.clients_refused, 1);
  return close_with(socket, kTryAgainLater,
                    "all places are taken; close another viewer or raise stream.max_clients");
}

void WebServer::forget(Connection& connection) {
  if (connection.slot == nullptr) return;
  connection.slot->socket = nullptr;
  connection.slot = nullptr;
  counters_.client_left();
  emit(EventCode::ClientGone);
}

void WebServer::emit(EventCode code) {
  const auto clients = static_cast<std::int64_t>(Counters::read(counters_.clients));
  // A full ring counts what it refuses.
  static_cast<void>(
      events_.try_push({.stamp_ns = monotonic_now(), .stage = Stage::Stream, .code = code, .a = clients}));
}

void WebServer::receive(Slot& slot, std::string_view piece) {
  slot.session.receive(feed_, piece, lws_is_first_fragment(slot.socket) != 0,
                       lws_is_final_fragment(slot.socket) != 0, lws_frame_is_binary(slot.socket) != 0,
                       monotonic_now());
  Counters::add(counters_.bad_messages, slot.session.take_bad_messages());
  if (slot.session.has_pending(feed_)) lws_callback_on_writable(slot.socket);
}

int WebServer::write(Slot& slot) {
  if (stopping_) return close_with(slot.socket, LWS_CLOSE_STATUS_GOINGAWAY, kEnding);
  if (slot.given_up) return -1;
  pass_cloud_turn();
  const Nanoseconds now_ns = monotonic_now();
  const std::span<std::uint8_t> out = scratch_.subspan(LWS_PRE);
  for (std::size_t sent = 0; sent < kBytesPerRound;) {
    const Chunk chunk = slot.session.next_chunk(feed_, out, now_ns);
    if (chunk.bytes == 0) return 0;
    const int kind = chunk.first ? (chunk.text ? LWS_WRITE_TEXT : LWS_WRITE_BINARY) : LWS_WRITE_CONTINUATION;
    const int flags = chunk.last ? kind : kind | LWS_WRITE_NO_FIN;
    if (lws_write(slot.socket, out.data(), chunk.bytes, static_cast<lws_write_protocol>(flags)) < 0)
      return -1;
    sent += chunk.bytes;
    Counters::add(counters_.bytes_sent, chunk.bytes);
    if (chunk.last) Counters::add(counters_.messages_sent, 1);
    if (lws_send_pipe_choked(slot.socket) != 0) break;
  }
  if (slot.session.has_pending(feed_)) lws_callback_on_writable(slot.socket);
  return 0;
}

Access::Verdict WebServer::judge(lws* socket, bool web_socket) {
  std::array<char, 256> host{}, origin{}, token{};
  std::array<char, 1024> cookies{};
  const auto header = [socket](std::span<char> into, lws_token_indexes which) -> std::string_view {
    const int bytes = lws_hdr_copy(socket, into.data(), static_cast<int>(into.size()), which);
    return {into.data(), static_cast<std::size_t>(std::max(bytes, 0))};
  };
  const char* value = lws_get_urlarg_by_name(socket, "token=", token.data(), static_cast<int>(token.size()));
  const auto verdict = access_.judge({.host = header(host, WSI_TOKEN_HOST),
                                      .origin = header(origin, WSI_TOKEN_ORIGIN),
                                      .token = value == nullptr ? std::string_view() : value,
                                      .cookies = header(cookies, WSI_TOKEN_HTTP_COOKIE)},
                                     web_socket);
  if (verdict != Access::Verdict::Welcome) Counters::add(counters_.clients_unwelcome, 1);
  return verdict;
}

int WebServer::filter(lws* socket) {
  const Access::Verdict verdict = judge(socket, true);
  if (verdict == Access::Verdict::Welcome) return 0;
  lws_return_http_status(socket, verdict == Access::Verdict::WrongToken ? 401 : 403, explain(verdict));
  return -1;
}

void WebServer::answer(lws* socket, std::string_view path) {
  const Access::Verdict verdict = judge(socket, false);
  if (verdict != Access::Verdict::Welcome) {
    reply(socket, {verdict == Access::Verdict::WrongToken ? 401U : 403U, "text/plain", explain(verdict)});
  } else if (lws_hdr_total_length(socket, WSI_TOKEN_GET_URI) > 0) {
    reply(socket, content_.find(path));
  } else {
    reply(socket, {405, "text/plain", "only GET\n"});
  }
}

void WebServer::reply(lws* socket, const HttpReply& reply) {
  const std::span<std::uint8_t> out = scratch_.subspan(LWS_PRE);
  STILLMAP_CHECK(reply.body.size() <= out.size());
  std::uint8_t *end_of_headers = out.data(), *const end = out.data() + out.size();
  const auto add = [&](const char* name, std::string_view value) {
    return lws_add_http_header_by_name(socket, reinterpret_cast<const std::uint8_t*>(name),
                                       reinterpret_cast<const std::uint8_t*>(value.data()),
                                       static_cast<int>(value.size()), &end_of_headers, end) == 0;
  };
  // The page needs nothing from elsewhere and tells nobody its address, which may hold the token.
  const bool ready =
      lws_add_http_common_headers(socket, reply.status, reply.type, reply.body.size(), &end_of_headers,
                                  end) == 0 &&
      add("connection:", "close") && add("cache-control:", "no-store") &&
      add("x-content-type-options:", "nosniff") && add("referrer-policy:", "no-referrer") &&
      add("content-security-policy:",
          "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; "
          "img-src data: blob:; frame-ancestors 'none'") &&
      (access_.cookie().empty() || reply.status != 200 || add("set-cookie:", access_.cookie())) &&
      lws_finalize_write_http_header(socket, out.data(), &end_of_headers, end) == 0;
  if (!ready) return;
  std::memcpy(out.data(), reply.body.data(), reply.body.size());
  if (lws_write(socket, out.data(), reply.body.size(), LWS_WRITE_HTTP_FINAL) < 0) return;
  Counters::add(counters_.bytes_sent, reply.body.size());
}

}  // namespace stillmap::stream
