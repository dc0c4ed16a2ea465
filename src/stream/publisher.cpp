// SPDX-License-Identifier: Apache-2.0
#include "stream/publisher.h"

#include <algorithm>

#include "stream/encoding.h"
#include "stream/scene_encoding.h"

namespace stillmap::stream {
namespace {

constexpr Nanoseconds kPictureInterval_ns = 95'000'000, kObjectsInterval_ns = 60'000'000,
                      kAnnotationsInterval_ns = 95'000'000;
// Pictures bring their own annotations; without any for this long, annotations come by themselves.
constexpr Nanoseconds kNoPicture_ns = 500'000'000;
constexpr std::size_t kPosesKept = 32, kLogLinesKept = 64;

template <std::size_t N>
void copy_text(std::array<char, N>& to, std::string_view text) {
  const std::size_t bytes = std::min(text.size(), N - 1);
  std::copy_n(text.begin(), bytes, to.begin());
  to[bytes] = '\0';
}

}  // namespace

Publisher::Publisher(Arena& arena, const Config& config, Feed& feed, Counters& counters)
    : config_(config),
      feed_(feed),
      counters_(counters),
      preview_(arena, config),
      poses_in_(arena.take<SpscRing<StreamPose, 64>>("stream.poses_in", 1)),
      scenes_in_(arena.take<SpscRing<StreamScene, 4>>("stream.scenes_in", 1)),
      scenes_(arena.take<StreamScene>("stream.scenes", kScenes)),
      health_in_(arena.take<LatestValue<StreamHealth>>("stream.health_in", 1)),
      logs_in_(arena.take<SpscRing<LogLine, 32>>("stream.log_in", 1)) {
  const auto add = [&](Channel channel, const char* name, std::size_t depth, std::size_t bytes) {
    feed.topic(channel) = Topic(arena, name, depth, bytes);
  };
  add(Channel::Transforms, "stream.tf", kPosesKept, kMaxTransformsBytes);
  add(Channel::Pose, "stream.pose", kPosesKept, kMaxPoseBytes);
  add(Channel::Objects, "stream.objects", 1, kMaxObjectsBytes);
  add(Channel::Picture, "stream.picture", 1, kMaxPayloadBytes);
  add(Channel::Annotations, "stream.annotations", 1, kMaxAnnotationsBytes);
  add(Channel::Calibration, "stream.calibration", 1, kMaxCalibrationBytes);
  add(Channel::Health, "stream.health", 1, kMaxHealthMessageBytes);
  add(Channel::Log, "stream.log", kLogLinesKept, kMaxLogBytes);
  static_assert(std::max({kMaxObjectsBytes, kMaxAnnotationsBytes}) <= kMaxPayloadBytes);
}

void Publisher::picture(const FrameSlot& frame, const Detections& own) {
  if (!picture_turn_.begin()) return;
  preview_.shrink(frame.colour);
  has_picture_ = true;
  picture_sequence_ = frame.sequence;
  picture_stamp_ns_ = frame.colour_ns;
  picture_boxes_ = own;
  picture_turn_.finish();
}

void Publisher::log(LogLevel level, const char* name, std::string_view text) {
  LogLine line{.level = level};
  copy_text(line.name, name);
  copy_text(line.text, text);
  static_cast<void>(logs_in_[0].try_push(LogLine(line)));  // the ring counts what it refuses
}

void Publisher::note_wanted(Channel channel, bool wanted) {
  bool& before = wanted_[index_of(channel)];
  // What was encoded for clients that have gone is out of date for the next one, unless it stays true.
  if (before && !wanted && channel != Channel::Log && channel != Channel::Calibration)
    feed_.topic(channel).forget();
  before = wanted;
}

void Publisher::take_poses() {
  const bool wanted = wants(Channel::Pose) || wants(Channel::Transforms);
  while (const auto pose = poses_in_[0].try_pop()) {
    pose_ = *pose;
    has_pose_ = pose_is_new_ = true;
    newest_stamp_ns_ = pose_.stamp_ns;
    if (wanted) encode_pose_topics();
  }
  if (!wanted) pose_is_new_ = has_pose_;  // to whoever subscribes next
  if (wanted && pose_is_new_) encode_pose_topics();
}

void Publisher::encode_pose_topics() {
  Topic &transforms = feed_.topic(Channel::Transforms), &pose = feed_.topic(Channel::Pose);
  transforms.publish(encode_transforms(pose_, transforms.room().first<kMaxTransformsBytes>()),
                     pose_.stamp_ns);
  pose.publish(encode_pose(pose_, pose.room().first<kMaxPoseBytes>()), pose_.stamp_ns);
  pose_is_new_ = false;
}

void Publisher::take_scenes(Nanoseconds now_ns) {
  scene_wanted_.store(wants(Channel::Objects) || wants(Channel::Annotations) || wants(Channel::Picture),
                      std::memory_order_relaxed);
  bool fresh = false;
  while (const auto scene = scenes_in_[0].try_pop()) {
    scenes_[scene_count_++ % kScenes] = *scene;
    newest_stamp_ns_ = scene->stamp_ns;
    fresh = true;
  }
  if (!fresh) return;
  const StreamScene& newest = scenes_[(scene_count_ - 1) % kScenes];
  if (wants(Channel::Objects) && now_ns - objects_ns_ >= kObjectsInterval_ns) {
    Topic& topic = feed_.topic(Channel::Objects);
    topic.publish(
        encode_objects(newest, config_.classes.names, config_.camera, topic.room().first<kMaxObjectsBytes>()),
        newest.stamp_ns);
    objects_ns_ = now_ns;
  }
  if (now_ns - pictured_ns_ >= kNoPicture_ns && now_ns - annotated_ns_ >= kAnnotationsInterval_ns)
    annotate(newest, now_ns);
}

void Publisher::annotate(const StreamScene& scene, Nanoseconds now_ns) {
  if (!wants(Channel::Annotations)) return;
  Topic& topic = feed_.topic(Channel::Annotations);
  topic.publish(encode_annotations(scene, config_.classes.names, preview_.size(),
                                   topic.room().first<kMaxAnnotationsBytes>()),
                scene.stamp_ns);
  annotated_ns_ = now_ns;
}

const StreamScene* Publisher::scene_of(std::uint64_t sequence) const {
  for (std::uint64_t i = scene_count_; i > 0 && i + kScenes > scene_count_; --i) {
    const StreamScene& scene = scenes_[(i - 1) % kScenes];
    if (scene.sequence == sequence) return &scene;
  }
  return nullptr;
}

void Publisher::take_picture(Nanoseconds now_ns) {
  const bool wanted = wants(Channel::Picture);
  if (!wanted) picture_turn_.reclaim();
  if (!picture_turn_.readable()) return;
  if (!wanted) {
    has_picture_ = false;
  } else if (has_picture_) {
    encode_preview(now_ns);
  } else if (now_ns - picture_asked_ns_ >= kPictureInterval_ns) {
    picture_asked_ns_ = now_ns;
    picture_turn_.offer();
  }
}

void Publisher::encode_preview(Nanoseconds now_ns) {
  const StreamScene* scene = scene_of(picture_sequence_);
  if (scene == nullptr) {
    // The tracker may still be at this frame. Once it is past it, or silent, what it knew of it will not come
    // any more, and a picture of which not all is known stays here.
    const bool passed =
        scene_count_ > 0 && scenes_[(scene_count_ - 1) % kScenes].sequence > picture_sequence_;
    if (!passed && now_ns - picture_asked_ns_ < kNoPicture_ns) return;
    Counters::add(counters_.pictures_withheld, 1);
    has_picture_ = false;
    return;
  }
  Topic& topic = feed_.topic(Channel::Picture);
  const std::size_t bytes = preview_.encode(picture_stamp_ns_, picture_boxes_, *scene, topic.room());
  if (bytes > 0) {
    topic.publish(bytes, picture_stamp_ns_);
    Counters::add(counters_.pictures_sent, 1);
    pictured_ns_ = now_ns;
    annotate(*scene, now_ns);
  }
  has_picture_ = false;
}

void Publisher::take_words() {
  health_is_new_ = health_in_[0].refresh() || health_is_new_;
  if (!wants(Channel::Health)) health_is_new_ = health_in_[0].generation() > 0;  // to whoever subscribes next
  if (wants(Channel::Health) && health_is_new_) {
    Topic& topic = feed_.topic(Channel::Health);
    topic.publish(encode_health(health_in_[0].value(), counters_.snapshot(), newest_stamp_ns_,
                                topic.room().first<kMaxHealthMessageBytes>()),
                  newest_stamp_ns_);
    health_is_new_ = false;
  }
  Topic& calibration = feed_.topic(Channel::Calibration);
  if (wants(Channel::Calibration) && calibration.end() == 0 && newest_stamp_ns_ > 0) {
    calibration.publish(encode_calibration(config_.camera, newest_stamp_ns_,
                                           calibration.room().first<kMaxCalibrationBytes>()),
                        newest_stamp_ns_);
  }
  while (const auto line = logs_in_[0].try_pop()) {
    Topic& topic = feed_.topic(Channel::Log);
    topic.publish(encode_log(line->level, line->name.data(), line->text.data(), newest_stamp_ns_,
                             topic.room().first<kMaxLogBytes>()),
                  newest_stamp_ns_);
  }
}

}  // namespace stillmap::stream
