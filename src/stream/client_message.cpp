// SPDX-License-Identifier: Apache-2.0
#include "stream/client_message.h"

#include <charconv>

namespace stillmap::stream {
namespace {

constexpr int kMaxDepth = 16;  // of nested values that are passed over: bounds the stack

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}
bool is_hex(char c) {
  return is_digit(c) || (c >= 'a' && c <= 'f') || (c >= 'A' && c <= 'F');
}

/// Reads JSON (RFC 8259) from front to back. Every call returns false when the text is not what it asks for.
class JsonReader {
 public:
  explicit JsonReader(std::string_view text) : rest_(text) {}

  bool at_end() {
    skip_space();
    return rest_.empty();
  }

  /// The text between the quotes, escapes as written.
  bool string(std::string_view& raw) {
    if (!take('"')) return false;
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      const char c = rest_[i];
      if (c == '"') {
        raw = rest_.substr(0, i);
        rest_.remove_prefix(i + 1);
        return true;
      }
      if (static_cast<unsigned char>(c) < 0x20) return false;
      if (c == '\\') {
        const std::size_t length = escape_length(rest_.substr(i));
        if (length == 0) return false;
        i += length - 1;
      }
    }
    return false;
  }

  bool whole_number(std::uint32_t& value) {
    skip_space();
    std::string_view text = rest_;
    if (!number()) return false;
    text = text.substr(0, text.size() - rest_.size());
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc() && end == text.data() + text.size();
  }

  /// Calls `on_item()` at each item of an array; it must read the item.
  template <class F>
  bool array(F on_item) {
    if (!take('[')) return false;
    if (take(']')) return true;
    do {
      if (!on_item()) return false;
    } while (take(','));
    return take(']');
  }

  /// Calls `on_value(key)` at the value of each key of an object; it must read the value.
  template <class F>
  bool object(F on_value) {
    if (!take('{')) return false;
    if (take('}')) return true;
    do {
      std::string_view key;
      if (!string(key) || !take(':') || !on_value(key)) return false;
    } while (take(','));
    return take('}');
  }

  /// Passes over any one value.
  bool skip(int depth = 0) {
    skip_space();
    if (rest_.empty() || depth > kMaxDepth) return false;
    std::string_view ignored;
    switch (rest_[0]) {
      case '{':
        return object([&](std::string_view) { return skip(depth + 1); });
      case '[':
        return array([&] { return skip(depth + 1); });
      case '"':
        return string(ignored);
      case 't':
        return word("true");
      case 'f':
        return word("false");
      case 'n':
        return word("null");
      default:
        return number();
    }
  }

 private:
  void skip_space() { rest_.remove_prefix(std::min(rest_.find_first_not_of(" \t\r\n"), rest_.size())); }

  bool take(char c) {
    skip_space();
    if (rest_.empty() || rest_[0] != c) return false;
    rest_.remove_prefix(1);
    return true;
  }

  bool word(std::string_view expected) {
    if (!rest_.starts_with(expected)) return false;
    rest_.remove_prefix(expected.size());
    return true;
  }

  bool digits() {
    std::size_t n = 0;
    while (n < rest_.size() && is_digit(rest_[n])) ++n;
    rest_.remove_prefix(n);
    return n > 0;
  }

  bool number() {
    if (rest_.starts_with('-')) rest_.remove_prefix(1);
    if (rest_.starts_with('0')) {
      rest_.remove_prefix(1);  // a leading zero stands alone
    } else if (!digits()) {
      return false;
    }
    if (rest_.starts_with('.')) {
      rest_.remove_prefix(1);
      if (!digits()) return false;
    }
    if (rest_.starts_with('e') || rest_.starts_with('E')) {
      rest_.remove_prefix(1);
      if (rest_.starts_with('+') || rest_.starts_with('-')) rest_.remove_prefix(1);
      if (!digits()) return false;
    }
    return true;
  }

  /// Length of the escape at the front of `text`; 0 when it is none.
  static std::size_t escape_length(std::string_view text) {
    if (text.size() < 2) return 0;
    if (text[1] != 'u') return std::string_view("\"\\/bfnrt").find(text[1]) == std::string_view::npos ? 0 : 2;
    if (text.size() < 6) return 0;
    for (std::size_t i = 2; i < 6; ++i) {
      if (!is_hex(text[i])) return 0;
    }
    return 6;
  }

  std::string_view rest_;
};

bool read_subscription(JsonReader& json, ClientMessage& message) {
  ClientMessage::Subscription subscription;
  bool has_id = false, has_channel = false;
  const bool ok = json.object([&](std::string_view key) {
    if (key == "id") return has_id = json.whole_number(subscription.id);
    if (key == "channelId") return has_channel = json.whole_number(subscription.channel_id);
    return json.skip();
  });
  return ok && has_id && has_channel && message.subscriptions.try_push_back(subscription);
}

bool read_subscription_id(JsonReader& json, ClientMessage& message) {
  std::uint32_t id = 0;
  return json.whole_number(id) && message.unsubscribed.try_push_back(id);
}

}  // namespace

ClientMessage parse_client_message(std::string_view text) {
  JsonReader json(text);
  ClientMessage message;
  std::string_view op;
  bool has_op = false, has_subscriptions = false, has_ids = false;
  const bool ok = json.object([&](std::string_view key) {
    if (key == "op") return has_op = json.string(op);
    if (key == "subscriptions") {
      return has_subscriptions = json.array([&] { return read_subscription(json, message); });
    }
    if (key == "subscriptionIds")
      return has_ids = json.array([&] { return read_subscription_id(json, message); });
    return json.skip();
  });
  if (!ok || !has_op || !json.at_end()) return {};
  if (op == "subscribe" && has_subscriptions) {
    message.kind = ClientMessage::Kind::Subscribe;
  } else if (op == "unsubscribe" && has_ids) {
    message.kind = ClientMessage::Kind::Unsubscribe;
  } else if (op != "subscribe" && op != "unsubscribe") {
    message.kind = ClientMessage::Kind::Unsupported;
  }
  return message;
}

}  // namespace stillmap::stream
