// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <span>
#include <string>
#include <vector>

#include "core/arena.h"
#include "core/config.h"
#include "core/frame_pool.h"
#include "core/latest_value.h"
#include "core/spsc_ring.h"
#include "stream/client_session.h"
#include "stream/counters.h"
#include "stream/handover.h"
#include "stream/preview.h"

namespace stillmap::stream {

/// Takes what the stages publish and encodes it into the feed's topics: once for all clients, and only what
/// somebody is subscribed to (log lines always: clients that come later get the last ones). Calls belong to
/// the threads that StreamServer says.
class Publisher {
 public:
  Publisher(Arena& arena, const Config& config, Feed& feed, Counters& counters);

  // Track thread.
  void pose(const StreamPose& pose) { static_cast<void>(poses_in_[0].try_push(StreamPose(pose))); }
  bool scene_wanted() const { return scene_wanted_.load(std::memory_order_relaxed); }
  void scene(const StreamScene& scene) { static_cast<void>(scenes_in_[0].try_push(StreamScene(scene))); }
  // Detector's thread; track thread where the preview is full.
  bool picture_wanted() const { return picture_turn_.wanted(); }
  void picture(const FrameSlot& frame, const Detections& own);
  // Health's thread.
  void health(const StreamHealth& health) { static_cast<void>(health_in_[0].publish(health)); }
  void log(LogLevel level, const char* name, std::string_view text);

  /// Stream thread. One round; `wanted(channel)` says whether anyone is subscribed.
  template <class Wanted>
  void round(Nanoseconds now_ns, Wanted&& wanted) {
    for (std::uint32_t id = 1; id <= kChannelCount; ++id)
      note_wanted(static_cast<Channel>(id), wanted(static_cast<Channel>(id)));
    take_poses();
    take_scenes(now_ns);
    take_picture(now_ns);
    take_words();
  }

  std::uint64_t poses_refused() const { return poses_in_[0].usage("stream.poses").refused; }

 private:
  static constexpr std::size_t kScenes = 16;  // kept, for pictures that the detector holds up
  struct LogLine {
    LogLevel level = LogLevel::Info;
    std::array<char, 16> name{};
    std::array<char, 200> text{};
  };

  void note_wanted(Channel channel, bool wanted);
  bool wants(Channel channel) const { return wanted_[index_of(channel)]; }
  void take_poses();
  void encode_pose_topics();
  void take_scenes(Nanoseconds now_ns);
  void take_picture(Nanoseconds now_ns);
  void encode_preview(Nanoseconds now_ns);
  void annotate(const StreamScene& scene, Nanoseconds now_ns);
  void take_words();
  const StreamScene* scene_of(std::uint64_t sequence) const;

  const Config config_;
  Feed& feed_;
  Counters& counters_;
  Preview preview_;
  std::array<bool, kChannelCount> wanted_{};
  std::atomic<bool> scene_wanted_{false};
  Nanoseconds newest_stamp_ns_ = 0;  // on the source's clock; what has no stamp of its own is sent with it

  std::span<SpscRing<StreamPose, 64>> poses_in_;
  StreamPose pose_;
  bool has_pose_ = false, pose_is_new_ = false;

  std::span<SpscRing<StreamScene, 4>> scenes_in_;
  std::span<StreamScene> scenes_;
  std::uint64_t scene_count_ = 0;
  Nanoseconds objects_ns_ = 0, annotated_ns_ = 0, pictured_ns_ = 0;  // when last, monotonic

  Handover picture_turn_;
  // The turn's owner's, as the preview's pixels are:
  bool has_picture_ = false;
  std::uint64_t picture_sequence_ = 0;
  Nanoseconds picture_stamp_ns_ = 0;
  Detections picture_boxes_;
  Nanoseconds picture_asked_ns_ = 0;

  std::span<LatestValue<StreamHealth>> health_in_;
  bool health_is_new_ = false;
  std::span<SpscRing<LogLine, 32>> logs_in_;
};

}  // namespace stillmap::stream
