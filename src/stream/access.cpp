// SPDX-License-Identifier: Apache-2.0
#include "stream/access.h"

#include <arpa/inet.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <fstream>

namespace stillmap::stream {
namespace {

constexpr std::string_view kCookieName = "stillmap_token=";
constexpr std::size_t kShortestToken = 16, kLongestToken = 128;
constexpr char kMakeToken[] = "`(umask 077; openssl rand -hex 16 > FILE)` makes one";

bool is_token_letter(char c) {
  return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' || c == '_' ||
         c == '.' || c == '~';
}

Error wrong_token_file(const std::string& path, const std::string& why) {
  return {ExitCode::WrongConfig, "stream.token_file = \"" + path + "\" " + why};
}

Result<std::string> read_token(const std::string& path) {
  struct stat status {};
  std::ifstream file;
  if (stat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode)) file.open(path);
  std::string token;
  if (!file.is_open() || !std::getline(file, token))
    return wrong_token_file(path, std::string("cannot be read; ") + kMakeToken);
  if ((status.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    return wrong_token_file(path, "can be read by other users; run `chmod 600 " + path + "`");
  if (token.size() < kShortestToken || token.size() > kLongestToken ||
      !std::ranges::all_of(token, is_token_letter)) {
    return wrong_token_file(
        path, std::string("does not begin with a line of 16 to 128 letters, digits or -_.~; ") + kMakeToken);
  }
  return token;
}

/// HOST or HOST:PORT without its port; an IPv6 address without its brackets.
std::string_view without_port(std::string_view host) {
  if (host.starts_with('['))
    return host.substr(1, host.find(']') == std::string_view::npos ? 0 : host.find(']') - 1);
  return host.substr(0, host.find(':'));
}

bool names_this_machine(std::string_view host) {
  const std::string_view name = without_port(host);
  std::array<char, 64> text{};
  if (name.empty() || name.size() >= text.size()) return false;
  if (name == "localhost") return true;
  std::ranges::copy(name, text.begin());
  in6_addr parsed{};
  return inet_pton(AF_INET, text.data(), &parsed) == 1 || inet_pton(AF_INET6, text.data(), &parsed) == 1;
}

/// The value of our cookie among `name=value; name=value`.
std::string_view token_cookie(std::string_view cookies) {
  while (!cookies.empty()) {
    std::string_view one = cookies.substr(0, cookies.find(';'));
    cookies.remove_prefix(std::min(cookies.size(), one.size() + 1));
    while (one.starts_with(' ')) one.remove_prefix(1);
    if (one.starts_with(kCookieName)) return one.substr(kCookieName.size());
  }
  return {};
}

}  // namespace

bool is_loopback(const ListenAddress& address) {
  return address.ipv6 ? address.host == "::1" : address.host.starts_with("127.");
}

bool equal_in_constant_time(std::string_view given, std::string_view expected) {
  unsigned different = given.size() == expected.size() ? 0 : 1;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const char c = i < given.size() ? given[i] : '\0';
    different |=
        static_cast<unsigned>(static_cast<unsigned char>(c) ^ static_cast<unsigned char>(expected[i]));
  }
  return different == 0;
}

Result<Access> Access::open(const Config::Stream& config, const ListenAddress& address) {
  const bool loopback = is_loopback(address);
  if (!loopback && config.token_file.empty()) {
    return Error{ExitCode::WrongConfig,
                 "stream.listen = \"" + config.listen +
                     "\" can be reached from other machines and needs stream.token_file; " + kMakeToken};
  }
  if (!loopback && config.preview == "full" && config.full_preview_to != "network") {
    return Error{ExitCode::WrongConfig,
                 "stream.preview = \"full\" shows people to other machines with stream.listen = \"" +
                     config.listen + "\"; choose \"masked\", or set stream.full_preview_to = \"network\""};
  }
  Access access;
  access.origins_ = config.origins;
  if (!config.token_file.empty()) {
    Result<std::string> token = read_token(config.token_file);
    if (!token.ok()) return token.error();
    access.token_ = token.value();
    access.cookie_ = std::string(kCookieName) + access.token_ + "; HttpOnly; SameSite=Strict; Path=/" +
                     (config.tls_certificate.empty() ? "" : "; Secure");
  }
  return access;
}

bool Access::has_token(const RequestFacts& request) const {
  // Both, always: no time tells which one was right.
  const bool by_address = equal_in_constant_time(request.token, token_);
  const bool by_cookie = equal_in_constant_time(token_cookie(request.cookies), token_);
  return by_address || by_cookie;
}

Access::Verdict Access::judge(const RequestFacts& request, bool web_socket) const {
  if (token_.empty() && !names_this_machine(request.host)) return Verdict::WrongHost;
  if (!token_.empty() && !has_token(request)) return Verdict::WrongToken;
  if (!web_socket || request.origin.empty()) return Verdict::Welcome;
  const std::size_t scheme = request.origin.find("://");
  const bool own = scheme != std::string_view::npos && request.origin.substr(scheme + 3) == request.host;
  return own || std::ranges::find(origins_, request.origin) != origins_.end() ? Verdict::Welcome
                                                                              : Verdict::WrongOrigin;
}

const char* explain(Access::Verdict verdict) {
  switch (verdict) {
    case Access::Verdict::Welcome:
      return "";
    case Access::Verdict::WrongHost:
      return "without a token, ask by a numeric address or localhost\n";
    case Access::Verdict::WrongToken:
      return "this needs the token of stream.token_file: add ?token=... to the address\n";
    case Access::Verdict::WrongOrigin:
      return "web pages from there may not connect: add their origin to stream.origins\n";
  }
  return "";
}

}  // namespace stillmap::stream
