// SPDX-License-Identifier: Apache-2.0
#include "stream/client_message.h"

#include <gtest/gtest.h>

#include <random>
#include <string>

namespace stillmap::stream {
namespace {

using Kind = ClientMessage::Kind;

TEST(ClientMessage, Subscribe) {
  const ClientMessage m = parse_client_message(
      " {\"subscriptions\" : [ {\"id\":0,\"channelId\":3},\n{\"channelId\":4294967295,\"x\":[{}],\"id\":7} "
      "], \"op\":\"subscribe\"} ");
  ASSERT_EQ(m.kind, Kind::Subscribe);
  ASSERT_EQ(m.subscriptions.size(), 2U);
  EXPECT_EQ(m.subscriptions[0].id, 0U);
  EXPECT_EQ(m.subscriptions[0].channel_id, 3U);
  EXPECT_EQ(m.subscriptions[1].id, 7U);
  EXPECT_EQ(m.subscriptions[1].channel_id, 4294967295U);
}

TEST(ClientMessage, Unsubscribe) {
  const ClientMessage m = parse_client_message(R"({"op":"unsubscribe","subscriptionIds":[5,6]})");
  ASSERT_EQ(m.kind, Kind::Unsubscribe);
  ASSERT_EQ(m.unsubscribed.size(), 2U);
  EXPECT_EQ(m.unsubscribed[1], 6U);
  EXPECT_EQ(parse_client_message(R"({"op":"unsubscribe","subscriptionIds":[]})").kind, Kind::Unsubscribe);
}

TEST(ClientMessage, OtherOperationsAreUnsupportedWhateverElseTheyHold) {
  for (const char* text :
       {R"({"op":"getParameters","parameterNames":["a\"\\\u00e9"],"id":null})", R"({"op":""})",
        R"({"a":-0.5e+10,"b":true,"c":false,"d":[[],[[1]],{"e":{}}],"op":"advertise"})",
        R"({"op":"subscribe\n"})"}) {
    EXPECT_EQ(parse_client_message(text).kind, Kind::Unsupported) << text;
  }
}

TEST(ClientMessage, EverythingElseIsMalformed) {
  for (const char* text : {"",
                           " ",
                           "hello",
                           "null",
                           "[]",
                           "{}",
                           "{",
                           "}",
                           R"({"op"})",
                           R"({"op":})",
                           R"({"op":1})",
                           R"({"op":"subscribe"})",
                           R"({"op":"unsubscribe"})",
                           R"({op:"subscribe"})",
                           R"({"op":"x",})",
                           R"({"op":"x"} x)",
                           R"({"op":"x"}{})",
                           R"({"op":"x)",
                           "{\"op\":\"x\n\"}",
                           R"({"op":"\x"})",
                           R"({"op":"\u12g4"})",
                           R"({"op":"\)",
                           R"({"op":"\u12)",
                           R"({"op":"x","a":01})",
                           R"({"op":"x","a":1.})",
                           R"({"op":"x","a":.5})",
                           R"({"op":"x","a":1e})",
                           R"({"op":"x","a":-})",
                           R"({"op":"x","a":+1})",
                           R"({"op":"x","a":tru})",
                           R"({"op":"x","a":NaN})",
                           R"({"op":"x","a":[1,]})",
                           R"({"op":"x","a":[1 2]})",
                           R"({"op":"x","a":'y'})",
                           R"({"op":"subscribe","subscriptions":{}})",
                           R"({"op":"subscribe","subscriptions":[1]})",
                           R"({"op":"subscribe","subscriptions":[{}]})",
                           R"({"op":"subscribe","subscriptions":[{"id":1}]})",
                           R"({"op":"subscribe","subscriptions":[{"channelId":1}]})",
                           R"({"op":"subscribe","subscriptions":[{"id":"1","channelId":1}]})",
                           R"({"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]})",
                           R"({"op":"subscribe","subscriptions":[{"id":1.0,"channelId":1}]})",
                           R"({"op":"subscribe","subscriptions":[{"id":1e2,"channelId":1}]})",
                           R"({"op":"subscribe","subscriptions":[{"id":4294967296,"channelId":1}]})",
                           R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":null}]})",
                           R"({"op":"unsubscribe","subscriptionIds":[true]})",
                           R"({"op":"unsubscribe","subscriptionIds":5})"}) {
    EXPECT_EQ(parse_client_message(text).kind, Kind::Malformed) << text;
  }
}

TEST(ClientMessage, MoreItemsThanFitAreRefusedWhole) {
  std::string text = R"({"op":"unsubscribe","subscriptionIds":[0)";
  for (std::size_t i = 1; i < ClientMessage::kMaxItems; ++i) text += ",1";
  EXPECT_EQ(parse_client_message(text + "]}").kind, Kind::Unsubscribe);
  EXPECT_EQ(parse_client_message(text + ",1]}").kind, Kind::Malformed);
}

TEST(ClientMessage, DeepNestingIsRefusedBeforeTheStackEnds) {
  const std::string start = R"({"op":"x","a":)";
  EXPECT_EQ(parse_client_message(start + std::string(10, '[') + std::string(10, ']') + "}").kind,
            Kind::Unsupported);
  EXPECT_EQ(parse_client_message(start + std::string(4000, '[')).kind, Kind::Malformed);
  EXPECT_EQ(parse_client_message(start + std::string(2000, '[') + std::string(2000, ']') + "}").kind,
            Kind::Malformed);
}

TEST(ClientMessage, DamagedMessagesNeverDoMoreThanTheySay) {
  const std::string good =
      R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":2},{"id":3,"channelId":1}],"n":[1.5e3,null]})";
  ASSERT_EQ(parse_client_message(good).kind, Kind::Subscribe);
  for (std::size_t n = 0; n < good.size(); ++n) {
    // A copy on the heap without a byte to spare, so that the sanitizer sees any step beyond it.
    const std::string cut = good.substr(0, n);
    EXPECT_EQ(
        parse_client_message(std::string_view(std::vector<char>(cut.begin(), cut.end()).data(), n)).kind,
        Kind::Malformed);
  }
  std::mt19937 random(1);
  const std::string alphabet = "{}[]\",:\\0123456789-+.eEu truefalsn\x01\xff";
  for (int round = 0; round < 20000; ++round) {
    std::vector<char> text(good.begin(), good.end());
    for (int edits = 1 + static_cast<int>(random() % 4); edits > 0; --edits) {
      text[random() % text.size()] = alphabet[random() % alphabet.size()];
    }
    const ClientMessage m = parse_client_message({text.data(), text.size()});
    EXPECT_LE(m.subscriptions.size(), 2U);
  }
}

}  // namespace
}  // namespace stillmap::stream
