// SPDX-License-Identifier: Apache-2.0
#include "stream/client_session.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
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

  ClientSessionTest() {
    for (const Channel channel : {Channel::Transforms, Channel::Pose})
      feed.topic(channel) = Topic(arena, "poses", kDepth, 16);
    feed.topic(Channel::Objects) = Topic(arena, "objects", 1, 16);
    feed.topic(Channel::Log) = Topic(arena, "log", kDepth, 16);
    blocks.use(block_memory);
    session.reset(blocks);
  }
  void tell(std::string_view text) { session.receive(feed, text, true, true, false, now); }
  void publish(Channel channel, Nanoseconds stamp_ns) {
    feed.topic(channel).room()[0] = static_cast<std::uint8_t>(channel);
    feed.topic(channel).publish(1, stamp_ns);
    dropped += session.drop_outdated(feed);
  }
  void publish(Nanoseconds stamp_ns) {
    publish(Channel::Transforms, stamp_ns);
    publish(Channel::Pose, stamp_ns);
  }
  /// The map's answer to what the session asks for: nothing (false), or these slots.
  bool answer(const std::vector<std::uint32_t>& slots, std::uint32_t next, bool complete,
              std::uint64_t version, std::uint32_t epoch = 0) {
    session.ask_for_blocks(now);
    if (!blocks.begin()) return false;
    asked = blocks.request();
    for (const std::uint32_t slot : slots) EXPECT_TRUE(blocks.add({.slot = slot, .count = 1}));
    blocks.finish({next, complete, version, epoch, 0.04, 5});
    session.ask_for_blocks(now);
    return true;
  }
  void publish_cloud(std::size_t points, Nanoseconds stamp_ns, std::uint32_t epoch = 0) {
    cloud.offer();
    const std::span<CloudPoint> to = cloud.begin();
    for (std::size_t i = 0; i < points; ++i) to[i].x = static_cast<float>(i);
    cloud.publish(points, stamp_ns, epoch);
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

  static constexpr std::uint64_t kDepth = 32;
  Arena arena{1 << 20};
  std::vector<CloudPoint> memory = std::vector<CloudPoint>(5000);
  Feed feed{{"info", "channels"}, true, memory};
  CloudExchange& cloud = feed.cloud;
  std::vector<std::uint8_t> block_memory = std::vector<std::uint8_t>(4096);
  BlockExchange blocks;
  BlockRequest asked;
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

TEST_F(ClientSessionTest, PosesBeginWithTheNewestAndComeInTurnAndInOrder) {
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
  const auto depth = static_cast<Nanoseconds>(kDepth);
  for (Nanoseconds t = 0; t < depth; ++t) publish(t);
  EXPECT_EQ(dropped, 0U);
  publish(depth);
  EXPECT_EQ(dropped, kDepth);
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), 1U);
  EXPECT_EQ(messages[0].stamp(), depth);
}

TEST_F(ClientSessionTest, ABusyMomentLosesNothing) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]})");
  for (Nanoseconds t = 0; t < static_cast<Nanoseconds>(kDepth); ++t) publish(t);
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), kDepth);
  for (std::size_t i = 0; i < messages.size(); ++i)
    EXPECT_EQ(messages[i].stamp(), static_cast<Nanoseconds>(i));
}

TEST_F(ClientSessionTest, TheCloudComesInChunksThatMakeOneMessage) {
  take_all();
  publish_cloud(5000, 7, 2);
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
  EXPECT_EQ(decoded.number<std::uint64_t>(1000), 2U);
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

TEST_F(ClientSessionTest, AnotherClientsCloudIsWaitedForAndPosesGoOn) {
  take_all();
  publish_cloud(5000, 1);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3},{"id":8,"channelId":2}]})");
  feed.cloud_under_way = true;
  publish(1);
  const auto poses = take_all();
  ASSERT_EQ(poses.size(), 1U);
  EXPECT_EQ(poses[0].subscription(), 8U);
  EXPECT_TRUE(session.owed_cloud(cloud));
  EXPECT_FALSE(session.has_cloud_turn(now));
  feed.cloud_under_way = false;
  session.next_chunk(feed, out, now);
  feed.cloud_under_way = true;  // its own: it goes on
  EXPECT_TRUE(session.has_cloud_turn(now + ClientSession::kCloudTurn_ns - 1));
  EXPECT_FALSE(session.has_cloud_turn(now + ClientSession::kCloudTurn_ns));
  do {
    chunk = session.next_chunk(feed, out, now);
    ASSERT_GT(chunk.bytes, 0U);
  } while (!chunk.last);
  EXPECT_FALSE(session.has_cloud_turn(now));
}

TEST_F(ClientSessionTest, UnsubscribingInTheMiddleOfACloudStillEndsTheMessage) {
  take_all();
  publish_cloud(5000, 1);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3},{"id":8,"channelId":2}]})");
  EXPECT_FALSE(session.next_chunk(feed, out, now).last);
  publish(1);
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

TEST_F(ClientSessionTest, IsIntolerableWhenACloudTakesTooLong) {
  take_all();
  publish_cloud(5000, 1);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  EXPECT_FALSE(session.intolerable(1000 * kSecond));
  now = 10 * kSecond;
  session.next_chunk(feed, out, now);
  EXPECT_TRUE(session.receiving_cloud());
  EXPECT_FALSE(session.intolerable(now + ClientSession::kCloudTimeout_ns));
  EXPECT_TRUE(session.intolerable(now + ClientSession::kCloudTimeout_ns + 1));
  while (!session.next_chunk(feed, out, now).last) continue;
  EXPECT_FALSE(session.intolerable(1000 * kSecond));
}

TEST_F(ClientSessionTest, EveryBadMessageIsAnsweredAndChangesNothing) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]})");
  const std::pair<const char*, const char*> cases[] = {
      {R"({"op":"subscribe","subscriptions":[{"id":2,"channelId":0}]})", "no channel 0"},
      {R"({"op":"subscribe","subscriptions":[{"id":2,"channelId":11}]})", "no channel 11"},
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
  session.receive(feed, R"({"op":"subscribe","subscri)", true, false, false, now);
  session.receive(feed, R"(ptions":[{"id":1,"channelId":1}]})", false, true, false, now);
  EXPECT_TRUE(session.subscribed(Channel::Transforms));
  const std::string piece(1000, ' ');
  session.receive(feed, R"({"op":"unsubscribe","subscriptionIds":[1]})", true, false, false, now);
  for (int i = 0; i < 100; ++i) session.receive(feed, piece, false, i == 99, false, now);
  EXPECT_TRUE(session.subscribed(Channel::Transforms));
  EXPECT_NE(take().bytes.find("too large"), std::string::npos);
  session.receive(feed, "{}", true, true, true, now);
  EXPECT_NE(take().bytes.find("not supported"), std::string::npos);
  tell(R"({"op":"unsubscribe","subscriptionIds":[1]})");
  EXPECT_FALSE(session.subscribed(Channel::Transforms));
  EXPECT_EQ(session.take_bad_messages(), 2U);
}

TEST_F(ClientSessionTest, OfWhatOnlyTheNewestCountsASlowClientGetsTheNewest) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":5}]})");
  for (Nanoseconds t = 1; t <= 10; ++t) publish(Channel::Objects, t);
  EXPECT_EQ(dropped, 9U);
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), 1U);
  EXPECT_EQ(messages[0].stamp(), 10);
}

TEST_F(ClientSessionTest, ALateClientGetsTheLastLogLines) {
  take_all();
  for (Nanoseconds t = 1; t <= 40; ++t) publish(Channel::Log, t);
  tell(R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":10}]})");
  const auto messages = take_all();
  ASSERT_EQ(messages.size(), kDepth);
  EXPECT_EQ(messages.front().stamp(), 9);
  EXPECT_EQ(messages.back().stamp(), 40);
}

TEST_F(ClientSessionTest, WhatComesOftenDoesNotKeepOutWhatComesSeldom) {
  take_all();
  tell(
      R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":1},{"id":2,"channelId":2},{"id":5,"channelId":5}]})");
  publish(Channel::Objects, 7);
  // A client so slow that poses never run out.
  std::vector<std::uint32_t> first;
  for (Nanoseconds t = 1; t <= 3; ++t) {
    publish(t);
    publish(t);
    first.push_back(take().subscription());
  }
  EXPECT_EQ(std::count(first.begin(), first.end(), 5U), 1);
}

TEST_F(ClientSessionTest, ThePreviewIsNoChannelWhereItIsOff) {
  Feed without{{}, false, memory};
  session.receive(without, R"({"op":"subscribe","subscriptions":[{"id":1,"channelId":6}]})", true, true,
                  false, now);
  EXPECT_FALSE(session.subscribed(Channel::Picture));
  EXPECT_EQ(session.take_bad_messages(), 1U);
}

TEST_F(ClientSessionTest, BlocksComeAsASnapshotAndThenAsPassesOverWhatChanged) {
  take_all();
  EXPECT_FALSE(answer({}, 0, true, 1)) << "nobody has subscribed";
  tell(R"({"op":"subscribe","subscriptions":[{"id":4,"channelId":4}]})");
  const auto decode = [](const Message& m) {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(m.bytes.data());
    return test::WireMessage(std::span(bytes, m.bytes.size()).subspan(kMessageHeaderBytes));
  };
  const auto flags = [&](const test::WireMessage& m) {
    return std::array{m.number<std::uint64_t>(4), m.number<std::uint64_t>(5), m.number<std::uint64_t>(6)};
  };
  ASSERT_TRUE(answer({0, 1}, 2, false, 10));
  EXPECT_EQ(asked.since, 0U);
  auto message = decode(take());
  EXPECT_EQ(flags(message), (std::array<std::uint64_t, 3>{0, 1, 0}));
  EXPECT_EQ(message.count(7), 2U);
  EXPECT_EQ(message.number<double>(3), 0.04);

  ASSERT_TRUE(answer({2}, 3, true, 12)) << "a pass that has begun goes on at once";
  EXPECT_EQ(asked.cursor, 2U);
  EXPECT_EQ(flags(decode(take())), (std::array<std::uint64_t, 3>{1, 1, 1}));

  EXPECT_FALSE(answer({}, 0, true, 12)) << "the next pass begins later";
  now += ClientSession::kBlockPass_ns;
  ASSERT_TRUE(answer({1}, 3, true, 13));
  EXPECT_EQ(asked.since, 10U) << "what changed during the pass comes again";
  EXPECT_EQ(asked.cursor, 0U);
  EXPECT_EQ(flags(decode(take())), (std::array<std::uint64_t, 3>{2, 0, 1}));

  now += ClientSession::kBlockPass_ns;
  ASSERT_TRUE(answer({}, 3, true, 13));
  EXPECT_EQ(asked.since, 13U);
  EXPECT_TRUE(take_all().empty()) << "nothing has changed, nothing is sent";
}

TEST_F(ClientSessionTest, APassBearsTheEpochOfItsBeginning) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":4,"channelId":4}]})");
  const auto epoch = [&] {
    const Message message = take();
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(message.bytes.data());
    return test::WireMessage(std::span(bytes, message.bytes.size()).subspan(kMessageHeaderBytes))
        .number<std::uint64_t>(8);
  };
  ASSERT_TRUE(answer({0}, 1, false, 10, 2));
  EXPECT_EQ(epoch(), 2U);
  ASSERT_TRUE(answer({1}, 2, true, 11, 3));
  EXPECT_EQ(epoch(), 2U) << "slot 0 may be as it was before the correction";
  now += ClientSession::kBlockPass_ns;
  ASSERT_TRUE(answer({}, 2, true, 11, 3));
  EXPECT_EQ(epoch(), 3U) << "a new epoch is told though no block has changed";
  now += ClientSession::kBlockPass_ns;
  ASSERT_TRUE(answer({}, 2, true, 11, 3));
  EXPECT_TRUE(take_all().empty()) << "it is told once";
}

TEST_F(ClientSessionTest, AnEmptyMapIsASnapshotToo) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":4,"channelId":4}]})");
  ASSERT_TRUE(answer({}, 0, true, 0));
  EXPECT_EQ(take_all().size(), 1U);
}

TEST_F(ClientSessionTest, BlocksThatTheClientBeforeAskedForAreNotItsSuccessors) {
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":4,"channelId":4}]})");
  session.ask_for_blocks(now);
  ASSERT_TRUE(blocks.begin());  // the map is at it when the client goes
  session.reset(blocks);
  take_all();
  tell(R"({"op":"subscribe","subscriptions":[{"id":4,"channelId":4}]})");
  session.ask_for_blocks(now);
  blocks.finish({9, false, 99, 0, 0.04, 5});
  EXPECT_TRUE(take_all().empty());
  ASSERT_TRUE(answer({0}, 1, true, 1));
  EXPECT_EQ(asked.cursor, 0U);
  EXPECT_EQ(take_all().size(), 1U);
}

TEST_F(ClientSessionTest, AClientThatSendsWithoutEndIsIntolerable) {
  for (int i = 0; i < ClientSession::kMaxMessagesPerSecond; ++i) tell("x");
  now += kSecond;
  for (int i = 0; i < ClientSession::kMaxMessagesPerSecond; ++i) tell("x");
  EXPECT_FALSE(session.intolerable(now));
  tell("x");
  EXPECT_TRUE(session.intolerable(now));
}

TEST_F(ClientSessionTest, ResetForgetsTheClientBefore) {
  take_all();
  publish_cloud(5000, 1);
  tell(R"({"op":"subscribe","subscriptions":[{"id":9,"channelId":3}]})");
  session.next_chunk(feed, out, now);
  tell("x");
  session.reset(blocks);
  EXPECT_FALSE(session.receiving_cloud());
  EXPECT_FALSE(session.subscribed(Channel::Map));
  EXPECT_EQ(take_all().size(), 2U);
}

}  // namespace
}  // namespace stillmap::stream
