// SPDX-License-Identifier: Apache-2.0
#include "stream/listen_address.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>

namespace stillmap::stream {

Result<ListenAddress> parse_listen_address(const std::string& text) {
  const Error wrong{ExitCode::WrongConfig,
                    "stream.listen: \"" + text +
                        "\" is not ADDR:PORT with a numeric address or localhost and a port from 0 to "
                        "65535; write for example 127.0.0.1:8765, [::1]:8765 or off"};
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) return wrong;
  ListenAddress address;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data() + colon + 1, end, address.port);
  if (error != std::errc() || stop != end || address.port < 0 || address.port > 65535) return wrong;
  address.ipv6 = colon >= 2 && text.front() == '[' && text[colon - 1] == ']';
  address.host = address.ipv6 ? text.substr(1, colon - 2) : text.substr(0, colon);
  if (address.host == "localhost") address.host = "127.0.0.1";
  in6_addr parsed{};
  if (inet_pton(address.ipv6 ? AF_INET6 : AF_INET, address.host.c_str(), &parsed) != 1) return wrong;
  return address;
}

Status check_can_listen(const ListenAddress& address) {
  sockaddr_storage storage{};
  socklen_t size = 0;
  if (address.ipv6) {
    auto* to = reinterpret_cast<sockaddr_in6*>(&storage);
    to->sin6_family = AF_INET6;
    to->sin6_port = htons(static_cast<std::uint16_t>(address.port));
    inet_pton(AF_INET6, address.host.c_str(), &to->sin6_addr);
    size = sizeof(sockaddr_in6);
  } else {
    auto* to = reinterpret_cast<sockaddr_in*>(&storage);
    to->sin_family = AF_INET;
    to->sin_port = htons(static_cast<std::uint16_t>(address.port));
    inet_pton(AF_INET, address.host.c_str(), &to->sin_addr);
    size = sizeof(sockaddr_in);
  }
  const int fd = ::socket(storage.ss_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  const bool ok = fd >= 0 && setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on)) == 0 &&
                  bind(fd, reinterpret_cast<const sockaddr*>(&storage), size) == 0 && listen(fd, 1) == 0;
  const int reason = errno;
  if (fd >= 0) close(fd);
  if (ok) return {};
  const std::string where =
      "stream.listen: cannot listen on " + address.host + " port " + std::to_string(address.port);
  switch (reason) {
    case EADDRINUSE:
      return Error{ExitCode::RunFailed,
                   where + ": it is in use; end the other program or choose another port"};
    case EADDRNOTAVAIL:
      return Error{ExitCode::RunFailed,
                   where + ": this machine has no such address; use one of `ip address`"};
    case EACCES:
      return Error{ExitCode::RunFailed, where + ": not permitted; choose a port from 1024 on"};
    default:
      return Error{ExitCode::RunFailed, where + ": " + std::strerror(reason)};
  }
}

}  // namespace stillmap::stream
