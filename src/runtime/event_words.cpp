// SPDX-License-Identifier: Apache-2.0
#include "runtime/event_words.h"

#include <spdlog/fmt/fmt.h>

#include <array>

#include "runtime/load_shedder.h"

namespace stillmap {

namespace {

constexpr LogLevel kInfo = LogLevel::Info, kWarning = LogLevel::Warning;

/// What there is to say of a code; {a} is the event's number, the other names stand for `arguments` below.
struct Words {
  LogLevel level;
  bool of_a_frame;  ///< the event's sequence number means one
  const char* format;
};

Words words_of(EventCode code) {
  switch (code) {
    using enum EventCode;
    case TrackingStarted:
      return {kInfo, true, "the first pose, from {a} points"};
    case TrackingWeak:
      return {kInfo, true, "{a} points match, track.weak_inliers = {weak_inliers}; the pose is uncertain"};
    case TrackingLost:
      return {kWarning, true,
              "{a} points match, track.min_inliers = {min_inliers}; no poses until something known is in "
              "view"};
    case Relocalized:
      return {kInfo, true, "found again in the map, by {a} points"};
    case SegmentStarted:
      return {kInfo, true,
              "lost for track.lost_s = {lost_s} s; segment {a} begins, to be joined where something known "
              "comes into view"};
    case LoopClosed:
      return {kInfo, true, "a known place came into view; the map is mended, for the {a}. time"};
    case QualityLowered:
      return {kWarning, true, "to {quality}, since poses come late"};
    case QualityRaised:
      return {kWarning, true, "to {quality}, since there is time again"};
    case DetectorFailed:
      return {kWarning, true,
              "the network gave no answer; earlier boxes serve for up to detector.max_age_ms = {max_age_ms} "
              "ms"};
    case StageLate:
      return {kWarning, true, "at work on one thing for {a} ms"};
    case StageInTime:
      return {kInfo, true, "has ended what took it so long"};
    case ClientConnected:
    case ClientGone:
      return {kInfo, false, "{a} of stream.max_clients = {max_clients} are connected now"};
    case SourceGone:
      return {kWarning, false,
              "unplugged, {a} ms after its last frame; tried anew for up to camera.give_up_s = {give_up_s} "
              "s"};
    case SourceStalled:
      return {kWarning, false,
              "no frame for {a} ms, camera.stall_s = {stall_s} s; tried anew for up to camera.give_up_s = "
              "{give_up_s} s"};
    case SourceRefused:
      return {kWarning, false, "try {a}: {refusal}"};
    case SourceBack:
      return {kInfo, false, "delivers frames again, tries: {a}"};
    case SourceTimeJump:
      return {kWarning, true, "the source's clock was set by {a} ms"};
    case DepthEmpty:
      return {kWarning, true,
              "{a} % of the pixels have no reading; is the depth camera covered, or too near?"};
    case DepthScale:
      return {kWarning, true,
              "{a} % of the readings lie outside camera.depth_min_m to camera.depth_max_m; is "
              "camera.depth_units_per_m = {units_per_m} right?"};
    case DepthUnregistered:
      return {
          kWarning, true,
          "its edges lie {a} px beside those of colour; is it registered? A depth camera that does not do "
          "so by itself needs camera.depth in the profile"};
  }
  return {kWarning, true, "{a}"};
}

// By DropReason.
constexpr std::array<const char*, kDropReasonCount> kDropWords{
    "the list names a picture that is not there",
    "the colour picture cannot be decoded",
    "the depth picture cannot be decoded",
    "not of camera.width x camera.height = {width} x {height} px",
    "no depth picture of the same moment",
    "every frame of the pool was in use",
    "the tracker went on to a newer one",
    "the stamp is not later than the one before",
    "lost by the camera or its driver"};

}  // namespace

LogWords event_words(const Event& event, const Config& config, const char* refusal) {
  const Words words = words_of(event.code);
  const auto step = static_cast<std::size_t>(event.a);
  const std::string said = fmt::format(
      fmt::runtime(words.format), fmt::arg("a", event.a),
      fmt::arg("quality", step < kSheddingPlan.size() ? kSheddingPlan[step].name : "?"),
      fmt::arg("refusal", refusal), fmt::arg("weak_inliers", config.track.weak_inliers),
      fmt::arg("min_inliers", config.track.min_inliers), fmt::arg("lost_s", config.track.lost_s),
      fmt::arg("max_age_ms", config.detector.max_age_ms), fmt::arg("max_clients", config.stream.max_clients),
      fmt::arg("stall_s", config.device.stall_s), fmt::arg("give_up_s", config.device.give_up_s),
      fmt::arg("units_per_m", config.camera.depth_units_per_m));
  const std::string frame = words.of_a_frame ? fmt::format(" at frame {}", event.sequence) : "";
  return {words.level, fmt::format("{}{}: {}", to_string(event.code), frame, said)};
}

std::string drop_words(DropReason reason, const CameraModel& camera) {
  return fmt::format("{} ({})", to_string(reason),
                     fmt::format(fmt::runtime(kDropWords[static_cast<std::size_t>(reason)]),
                                 fmt::arg("width", camera.width), fmt::arg("height", camera.height)));
}

}  // namespace stillmap
