// SPDX-License-Identifier: Apache-2.0
#include "core/mailbox.h"

#include <gtest/gtest.h>

#include <memory>
#include <thread>

#include "core/correction.h"

namespace stillmap {
namespace {

TEST(Mailbox, HasNoRoomUntilTheLastValueWasTaken) {
  Mailbox<int> mailbox;
  EXPECT_EQ(mailbox.waiting(), nullptr);
  *mailbox.room() = 5;
  EXPECT_EQ(mailbox.waiting(), nullptr) << "not posted yet";
  mailbox.post();
  EXPECT_EQ(mailbox.room(), nullptr);
  ASSERT_NE(mailbox.waiting(), nullptr);
  EXPECT_EQ(*mailbox.waiting(), 5);
  mailbox.taken();
  EXPECT_EQ(mailbox.waiting(), nullptr);
  EXPECT_NE(mailbox.room(), nullptr);
}

TEST(Mailbox, TwoThreadsSeeWholeCorrectionsInOrder) {
  constexpr std::uint32_t kLast = 200;
  const auto mailbox = std::make_unique<Mailbox<Correction>>();
  std::thread writer([&] {
    for (std::uint32_t epoch = 1; epoch <= kLast;) {
      Correction* room = mailbox->room();
      if (room == nullptr) {
        std::this_thread::yield();
        continue;
      }
      room->epoch = epoch;
      room->keyframes.clear();
      for (std::uint32_t id = 0; id < epoch; ++id)
        ASSERT_TRUE(room->keyframes.try_push_back({epoch + id, {}}));
      mailbox->post();
      ++epoch;
    }
  });
  for (std::uint32_t epoch = 1; epoch <= kLast;) {
    const Correction* correction = mailbox->waiting();
    if (correction == nullptr) {
      std::this_thread::yield();
      continue;
    }
    EXPECT_EQ(correction->epoch, epoch);
    EXPECT_EQ(correction->keyframes.size(), epoch);
    EXPECT_EQ(correction->keyframes[epoch - 1].id, 2 * epoch - 1);
    mailbox->taken();
    ++epoch;
  }
  writer.join();
}

}  // namespace
}  // namespace stillmap
