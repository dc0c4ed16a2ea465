// SPDX-License-Identifier: Apache-2.0
#include "runtime/reopening_source.h"

#include <algorithm>
#include <utility>

#include "runtime/heap_count.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kFirstPause = 250'000'000, kLongestPause = 2'000'000'000;

}  // namespace

ReopeningSource::ReopeningSource(Factory make, Patience patience, SourceNews& news)
    : make_(std::move(make)), patience_(patience), news_(news) {}

Status ReopeningSource::open() {
  camera_ = make_();
  if (Status s = camera_->open(); !s.ok()) return s;
  info_ = camera_->describe();
  return {};
}

Status ReopeningSource::start() {
  alive_ns_ = delivered_ns_ = monotonic_now();
  return camera_->start();
}

void ReopeningSource::stop() {
  if (camera_ != nullptr) camera_->stop();
}

GrabResult ReopeningSource::grab(FrameSlot& slot, Nanoseconds deadline_ns) {
  if (camera_ == nullptr) return wait_for_return(deadline_ns);
  const GrabResult result = camera_->grab(slot, deadline_ns);
  const Nanoseconds now = monotonic_now();
  switch (result.status) {
    case GrabStatus::Frame:
    case GrabStatus::Dropped:
      alive_ns_ = delivered_ns_ = now;
      if (tries_ > 0) tell(EventCode::SourceBack, std::exchange(tries_, 0));
      return result;
    case GrabStatus::Timeout:
      if (to_seconds(now - alive_ns_) < patience_.stall_s) return result;
      return lose(EventCode::SourceStalled);
    case GrabStatus::Lost:
      return lose(EventCode::SourceGone);
    case GrabStatus::EndOfStream:
      return result;
  }
  return result;
}

GrabResult ReopeningSource::lose(EventCode code) {
  const HeapScope scope(HeapOwner::Driver);
  camera_->stop();
  camera_.reset();
  if (tries_ > 0)
    return try_later(info_.name + ": can be opened, but delivers nothing; unplug it and plug it in again");
  refusal_told_.clear();
  pause_ns_ = kFirstPause;
  next_try_ns_ = monotonic_now() + pause_ns_;
  tell(code, static_cast<std::int64_t>(to_ms(monotonic_now() - delivered_ns_)));
  return {GrabStatus::Timeout};
}

GrabResult ReopeningSource::wait_for_return(Nanoseconds deadline_ns) {
  const Nanoseconds now = monotonic_now();
  if (now < next_try_ns_) {
    never_woken_.wait(never_woken_.ticket(), std::min(deadline_ns, next_try_ns_) - now);
    if (monotonic_now() < next_try_ns_) return {GrabStatus::Timeout};
  }
  const HeapScope scope(HeapOwner::Driver);
  const Status opened = reopen();
  return opened.ok() ? GrabResult{GrabStatus::Timeout} : try_later(opened.error().message);
}

GrabResult ReopeningSource::try_later(const std::string& why) {
  if (why != refusal_told_) {
    refusal_told_ = why;
    SourceNews::Words words{};
    why.copy(words.data(), words.size() - 1);
    news_.refusal.publish(words);
    tell(EventCode::SourceRefused, tries_);
  }
  if (to_seconds(monotonic_now() - delivered_ns_) >= patience_.give_up_s) return {GrabStatus::Lost};
  pause_ns_ = std::min(2 * pause_ns_, kLongestPause);
  next_try_ns_ = monotonic_now() + pause_ns_;
  return {GrabStatus::Timeout};
}

Status ReopeningSource::reopen() {
  ++tries_;
  std::unique_ptr<RgbdDriver> camera = make_();
  if (Status s = camera->open(); !s.ok()) return s;
  // The pool's frames have the size of the first one.
  const SourceInfo info = camera->describe();
  if (info.width != info_.width || info.height != info_.height) {
    return Error{ExitCode::WrongConfig, info.name +
                                            ": came back with pictures of another size; plug the first "
                                            "camera in again"};
  }
  if (Status s = camera->start(); !s.ok()) return s;
  camera_ = std::move(camera);
  alive_ns_ = monotonic_now();
  return {};
}

void ReopeningSource::tell(EventCode code, std::int64_t a) {
  static_cast<void>(news_.events.try_push({monotonic_now(), Stage::Capture, code, 0, a}));
}

}  // namespace stillmap
