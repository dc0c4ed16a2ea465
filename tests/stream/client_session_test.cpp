// SPDX-License-Identifier: Apache-2.0
#include "stream/client_session.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "wire_reader.h"

namespace stillmap::stream {
namespace {

constexpr Nanoseconds kSecond = 1'000'000'000;

/// One client and what it is fed from; `take` plays the socket.
struct ClientSessionTest : testing::Test {
  struct Message {
    bool text = false;
    std::string bytes;
    int chunks = 0;
    std::uint32_t subscription() const { return static_cast<std::uint8_t>(bytes[1]); }
    Nanoseconds stamp() const {
      Nanoseconds stamp = 0;
      std::memcpy(&stamp, &bytes[5], sizeof(stamp));
      return stamp;
    }
  };

  void tell(std::string_view text) { session.receive(feed, text, true, true, false); }
  void publish(Nanoseconds stamp_ns) {
    StreamPose pose;
    pose.stamp_ns = stamp_ns;
    history[0].push(pose);
    dropped += session.drop_outdated(feed);
  }
  void publish_cloud(std::size_t points, Nanoseconds stamp_ns) {
    cloud.offer();
    const std::span<CloudPoint> to = cloud.begin();
    for (std::size_t i = 0; i < points; ++i) to[i].x = static_cast<float>(i);
    cloud.publish(points, stamp_ns);
  }
  /// The next whole message; empty when nothing is pending.
  Message take() {
    Message message;
    for (bool last = false; !last; last = chunk.last) {
      const bool pending = session.has_pending(feed);
      chunk = session.next_chunk(feed, out, now);
      EXPECT_EQ(pending, chunk.bytes > 0);
      EXPECT_EQ(chunk.first, message.chunks == 0);
      message.text = chunk.text;
      message.bytes.append(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(chunk.bytes));
      ++message.chunks;
    }
    return message;
  }
  std::vector<Message> take_all() {
    std::vector<Message> messages;
    while (session.has_pending(feed)) messages.push_back(take());
    EXPECT_TRUE(take().bytes.empty());
    return messages;
  }

  std::vector<PoseHistory> history{1};
  std::vector<CloudPoint> memory{5000};
  CloudExchange cloud{memory};
  Feed feed{"info", "channels", history, cloud};
  ClientSession session;
  Chunk chunk;
  std::vector<std::uint8_t> out = std::vector<std::uint8_t>(8192);
  Nanoseconds now = 0;
  std::uint64_t dropped = 0;
};

TEST_F(ClientSessionTest, GreetsOnceAndThenWaitsToBeAsked) {
  publish(1);
  publish_cloud(10, 1);
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), 2U);
  EXPECT_EQ(messages[0].bytes, "info");
  EXPECT_EQ(messages[1].bytes, "channels");
  EXPECT_TRUE(messages[1].text);
}

TEST_F(ClientSessionTest, PosesBeginWithTheNewestAndComeInPairsInOrder) {
  for (Nanoseconds t = 1; t <= 5; ++t) publish(t);
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":40,"channelId":2},{"id":50,"channelId":1}]})");
  publish(6);
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(messages[i].subscription(), i % 2 == 0 ? 50U : 40U);
    EXPECT_EQ(messages[i].stamp(), i < 2 ? 5 : 6);
    EXPECT_FALSE(messages[i].text);
  }
  EXPECT_EQ(dropped, 0U);
}

TEST_F(ClientSessionTest, ASlowClientGoesOnWithTheNewestAndTheRestIsCounted) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":2}]})");
  const auto depth = static_cast<Nanoseconds>(PoseHistory::kDepth);
  for (Nanoseconds t = 0; t < depth; ++t) publish(t);
  EXPECT_EQ(dropped, 0U);
  publish(depth);
  EXPECT_EQ(dropped, PoseHistory::kDepth);
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), 1U);
  EXPECT_EQ(messages[0].stamp(), depth);
}

TEST_F(ClientSessionTest, ABusyMomentLosesNothing) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]})");
  for (Nanoseconds t = 0; t < static_cast<Nanoseconds>(PoseHistory::kDepth); ++t) publish(t);
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), PoseHistory::kDepth);
  for (std::size_t i = 0; i < messages.size(); ++i)
    EXPECT_EQ(messages[i].stamp(), static_cast<Nanoseconds>(i));
}

TEST_F(ClientSessionTest, TheCloudComesInChunksThatMakeOneMessage) {
  take_all();
  publish_cloud(5000, 7);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  EXPECT_TRUE(session.owed_cloud(cloud));
  const Message message = take();
  EXPECT_EQ(message.chunks, 10);  // 80,000 bytes and an envelope in pieces of 8192
  EXPECT_EQ(message.subscription(), 9U);
  EXPECT_EQ(message.stamp(), 7);
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(message.bytes.data());
  const test::WireMessage decoded(std::span(bytes, message.bytes.size()).subspan(kMessageHeaderBytes));
  ASSERT_FALSE(decoded.broken());
  const std::string points(reinterpret_cast<const char*>(memory.data()), 80'000);
  EXPECT_TRUE(decoded.text(6) == points);
  EXPECT_TRUE(take_all().empty());
  EXPECT_FALSE(session.owed_cloud(cloud));
}

TEST_F(ClientSessionTest, AnEmptyCloudIsSentAsOne) {
  take_all();
  publish_cloud(0, 7);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  EXPECT_EQ(take_all().size(), 1U);
}

TEST_F(ClientSessionTest, EachCloudGoesOutOnceAndOnlyWhenItMayBeRead) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  EXPECT_TRUE(take_all().empty());
  publish_cloud(1, 1);
  EXPECT_EQ(take_all().size(), 1U);
  EXPECT_TRUE(take_all().empty());
  publish_cloud(1, 2);
  EXPECT_EQ(take_all().size(), 1U);
  tell(R"({"op":"unsubscribe","subscriptionIds":[9]})");
  cloud.offer();
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  EXPECT_TRUE(session.owed_cloud(cloud));
  EXPECT_FALSE(session.has_pending(feed));  // the map may be writing
  cloud.reclaim();
  EXPECT_EQ(take_all().size(), 1U);
}

TEST_F(ClientSessionTest, UnsubscribingInTheMiddleOfACloudStillEndsTheMessage) {
  take_all();
  publish_cloud(5000, 1);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3},{"id":8,"channelId":2}]})");
  publish(1);
  EXPECT_FALSE(session.next_chunk(feed, out, now).last);
  tell(R"({"op":"unsubscribe","subscriptionIds":[9]})");
  tell("nonsense");
  Chunk next;
  do {
    next = session.next_chunk(feed, out, now);
    EXPECT_FALSE(next.first);
    EXPECT_FALSE(next.text);
  } while (!next.last);
  const auto rest = take_all();
  ASSERT_EQ(rest.size(), 2U);
  EXPECT_TRUE(rest[0].text);
  EXPECT_EQ(rest[1].subscription(), 8U);
}

TEST_F(ClientSessionTest, IsOverdueWhenACloudTakesTooLong) {
  take_all();
  publish_cloud(5000, 1);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  EXPECT_FALSE(session.overdue(1000 * kSecond));
  now = 10 * kSecond;
  session.next_chunk(feed, out, now);
  EXPECT_TRUE(session.receiving_cloud());
  EXPECT_FALSE(session.overdue(now + ClientSession::kCloudTimeout_ns));
  EXPECT_TRUE(session.overdue(now + ClientSession::kCloudTimeout_ns + 1));
  while (!session.next_chunk(feed, out, now).last) continue;
  EXPECT_FALSE(session.overdue(1000 * kSecond));
}

TEST_F(ClientSessionTest, EveryBadMessageIsAnsweredAndChangesNothing) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]})");
  const std::pair<const char*, const char*> cases[] = {
      {R"({"op":"subscribe","subscriptions":[{"id":2,"channelId":0}]})", "no channel 0"},
      {R"({"op":"subscribe","subscriptions":[{"id":2,"channelId":4}]})", "no channel 4"},
      {R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":2}]})", "id 1 is in use"},
      {R"({"op":"subscribe","subscriptions":[{"id":2,"channelId":1}]})", "already subscribed to channel 1"},
      {R"({"op":"unsubscribe","subscriptionIds":[2]})", "no subscription 2"},
      {R"({"op":"fetchAsset","uri":"file:///etc/passwd"})", "not supported"},
      {"\"", "not a message"}};
  for (const auto& [text, answer] : cases) {
    tell(text);
    const auto messages = take_all();
    ASSERT_EQ(messages.size(), 1U) << text;
    EXPECT_TRUE(messages[0].text);
    EXPECT_EQ(messages[0].bytes.find("{\"op\":\"status\",\"level\":2,"), 0U);
    EXPECT_NE(messages[0].bytes.find(answer), std::string::npos) << messages[0].bytes;
  }
  EXPECT_EQ(session.take_bad_messages(), 7U);
  EXPECT_EQ(session.take_bad_messages(), 0U);
  publish(1);
  EXPECT_EQ(take_all().size(), 1U);
}

TEST_F(ClientSessionTest, AFloodOfBadMessagesIsCountedAndAnsweredInPart) {
  take_all();
  for (int i = 0; i < 1000; ++i) tell("x");
  EXPECT_EQ(session.take_bad_messages(), 1000U);
  EXPECT_EQ(take_all().size(), 8U);
}

TEST_F(ClientSessionTest, MessagesMayComeInPiecesAndTooLargeOnesAreRefusedOnce) {
  take_all();
  session.receive(feed, R"({"op":"subscribe","subscri)", true, false, false);
  session.receive(feed, R"(ptions":[{"id":1,"channelId":1}]})", false, true, false);
  EXPECT_TRUE(session.subscribed(Channel::Transforms));
  const std::string piece(1000, ' ');
  session.receive(feed, R"({"op":"unsubscribe","subscriptionIds":[1]})", true, false, false);
  for (int i = 0; i < 100; ++i) session.receive(feed, piece, false, i == 99, false);
  EXPECT_TRUE(session.subscribed(Channel::Transforms));
  EXPECT_NE(take().bytes.find("too large"), std::string::npos);
  session.receive(feed, "{}", true, true, true);
  EXPECT_NE(take().bytes.find("not supported"), std::string::npos);
  tell(R"({"op":"unsubscribe","subscriptionIds":[1]})");
  EXPECT_FALSE(session.subscribed(Channel::Transforms));
  EXPECT_EQ(session.take_bad_messages(), 2U);
}

TEST_F(ClientSessionTest, ResetForgetsTheClientBefore) {
  take_all();
  publish_cloud(5000, 1);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  session.next_chunk(feed, out, now);
  tell("x");
  session.reset();
  EXPECT_FALSE(session.receiving_cloud());
  EXPECT_FALSE(session.subscribed(Channel::Map));
  EXPECT_EQ(take_all().size(), 2U);
}

}  // namespace
}  // namespace stillmap::stream
