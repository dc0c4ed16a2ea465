// SPDX-License-Identifier: Apache-2.0
#include "runtime/run_context.h"

#include "detect/box_carrier.h"
#include "runtime/block_feed.h"
#include "runtime/capture.h"
#include "runtime/heap_count.h"
#include "runtime/scene.h"

namespace stillmap {

namespace {

void note_state(RunContext& context, const TrackingResult& result, TrackState before) {
  if (result.state == before) return;
  if (before == TrackState::Lost && result.segment != context.segment_told) {
    context.emit(Stage::Track, EventCode::SegmentStarted, result.sequence, result.segment);
    context.segment_told = result.segment;
    return;
  }
  context.segment_told = result.segment;
  EventCode code = EventCode::TrackingWeak;
  if (before == TrackState::Initializing) code = EventCode::TrackingStarted;
  if (before == TrackState::Lost) code = EventCode::Relocalized;
  if (before == TrackState::Weak && result.state == TrackState::Tracking) return;
  if (result.state == TrackState::Lost) code = EventCode::TrackingLost;
  context.emit(Stage::Track, code, result.sequence, result.inliers);
}

void publish(RunContext& context, const TrackingResult& result) {
  StreamServer& server = *context.stages.stream;
  const TrackStage& track = context.stages.track;
  if (server.scene_wanted()) {
    StreamScene scene;
    make_scene(result, track.mask(), track.tracker().features(), scene);
    server.publish_scene(scene);
  }
  if (!result.has_pose()) return;
  const Pose T_base_camera = track.T_base_camera();
  server.publish_pose({result.stamp_ns, result.T_map_odom, result.T_odom_camera * inverse(T_base_camera),
                       T_base_camera, result.correction_epoch});
}

/// Tells the map and the final trajectory where keyframes are since the last correction; where the map has
/// not taken the last one yet, after the next frame.
void pass_correction(RunContext& context, const TrackingResult& result) {
  if (result.correction_epoch == context.epoch_passed) return;
  Mailbox<Correction>& corrections = context.stages.map.corrections();
  Correction* room = corrections.room();
  if (room == nullptr) return;
  context.stages.track.tracker().describe_keyframes(*room);
  context.stages.final_trajectory.correct(*room);
  corrections.post();
  context.epoch_passed = result.correction_epoch;
  context.emit(Stage::Track, EventCode::LoopClosed, result.sequence, result.correction_epoch);
}

}  // namespace

bool track_frame(RunContext& context, const FrameSlot& frame) {
  const HeapScope scope(HeapOwner::Track);
  const auto before = static_cast<TrackState>(context.counters.state.load(std::memory_order_relaxed));
  const Nanoseconds begin = monotonic_now(), cpu_begin = thread_cpu_now();
  const TrackingResult& result = context.stages.track.step(frame);
  context.track_log.track_time.add(monotonic_now() - begin);
  context.track_log.track_cpu_time.add(thread_cpu_now() - cpu_begin);
  pass_correction(context, result);
  if (result.has_pose())
    context.stages.final_trajectory.note(result, context.stages.track.tracker().T_odom_reference_keyframe());
  context.stages.track.serve_checkpoint();
  const bool first = context.track_log.first_pose_ns == 0;
  context.track_log.note(result, before, frame.due_ns, context.counters);
  if (first && context.track_log.first_pose_ns != 0) start_heap_count();
  note_state(context, result, before);
  context.flight.put({.at_ns = monotonic_now(),
                      .stamp_ns = result.stamp_ns,
                      .sequence = result.sequence,
                      .state = result.state,
                      .matches = result.matches,
                      .inliers = result.inliers,
                      .labels = result.labels,
                      .T_map_camera = result.T_map_camera()});
  context.counters.points.note(context.stages.track.tracker().point_usage());
  context.counters.keyframe_pool.note(context.stages.track.tracker().keyframe_usage());
  if (context.stages.stream) publish(context, result);
  return result.stands_on_points();
}

void adjust_map(RunContext& context) {
  const HeapScope scope(HeapOwner::Track);
  if (context.stages.track.adjustment().waits()) {
    const Nanoseconds begin = monotonic_now();
    context.stages.track.adjustment().work();
    context.adjust_time.add(monotonic_now() - begin);
  }
  context.stages.track.loops().work();
}

void offer_picture(RunContext& context, const FrameSlot& frame, const Detections& own) {
  if (!context.stages.stream || !context.stages.stream->picture_wanted()) return;
  if (context.detector == nullptr && context.config.stream.preview != "full") return;
  context.stages.stream->publish_picture(frame, own);
}

void answer_map_requests(RunContext& context) {
  if (!context.stages.stream) return;
  MapStage& map = context.stages.map;
  map.answer_cloud_request(*context.stages.stream);
  feed_blocks(map.map(), map.newest_ns(), *context.stages.stream);
}

void adapt_quality(RunContext& context, const FrameSlot& frame, bool lost_frames) {
  const LoadShedder::Change change = context.shedder.note(monotonic_now() - frame.due_ns, lost_frames);
  const int step = context.shedder.step();
  if (step > 0) RunCounters::bump(context.counters.frames_shed);
  if (change == LoadShedder::Change::None) return;
  const bool lowered = change == LoadShedder::Change::Lowered;
  RunCounters::bump(lowered ? context.counters.quality_lowered : context.counters.quality_raised);
  context.emit(Stage::Track, lowered ? EventCode::QualityLowered : EventCode::QualityRaised, frame.sequence,
               step);
  context.quality.store(step, std::memory_order_relaxed);
  context.stages.track.set_feature_share(quality_now(context).feature_share);
}

bool detect_frame(RunContext& context, const FrameSlot& frame, Detections& out) {
  const HeapScope scope(HeapOwner::Detect);
  const Nanoseconds begin = monotonic_now();
  const bool ok = context.detector->run(frame, out);
  if (ok) {
    measure_depths(out, frame.depth, context.config.camera);
    RunCounters::bump(context.counters.detector_runs);
    context.detect_time.add(monotonic_now() - begin);
  } else {
    RunCounters::bump(context.counters.detector_failures);
    context.emit(Stage::Detect, EventCode::DetectorFailed, frame.sequence, 0);
  }
  return ok;
}

}  // namespace stillmap
