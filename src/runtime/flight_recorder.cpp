// SPDX-License-Identifier: Apache-2.0
#include "runtime/flight_recorder.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstring>

namespace stillmap {

namespace {

/// One line of text, made without the heap or the C library's formatting, which a signal handler must not
/// use.
class Line {
 public:
  Line& add(const char* word) {
    if (used_ > 0) put(' ');
    while (*word != '\0') put(*word++);
    return *this;
  }
  Line& add(std::int64_t value) {
    std::array<char, 24> digits{};
    std::size_t count = 0;
    // Negative throughout: the least number has no positive counterpart.
    for (std::int64_t rest = value > 0 ? -value : value; rest != 0 || count == 0; rest /= 10)
      digits[count++] = static_cast<char>('0' - rest % 10);
    if (used_ > 0) put(' ');
    if (value < 0) put('-');
    while (count > 0) put(digits[--count]);
    return *this;
  }
  bool write_to(int file) {
    text_[used_++] = '\n';
    const bool whole = ::write(file, text_.data(), used_) == static_cast<ssize_t>(used_);
    used_ = 0;
    return whole;
  }

 private:
  void put(char c) {
    if (used_ + 1 < text_.size()) text_[used_++] = c;
  }
  std::array<char, 400> text_{};
  std::size_t used_ = 0;
};

std::int64_t millionths(double value) {
  return static_cast<std::int64_t>(value * 1e6);
}

Line line_of(const FlightFrame& f) {
  Line line;
  line.add("frame")
      .add(f.at_ns)
      .add(f.stamp_ns)
      .add(static_cast<std::int64_t>(f.sequence))
      .add(to_string(f.state));
  line.add(f.matches).add(f.inliers).add(f.labels.static_points).add(f.labels.dynamic);
  line.add(f.labels.semi_static).add(f.labels.unknown);
  const Vec3& t = f.T_map_camera.t;
  const Quaternion q = quaternion_from(f.T_map_camera.R);
  for (const double v : {t.x, t.y, t.z, q.x, q.y, q.z, q.w}) line.add(millionths(v));
  return line;
}

Line line_of(const Event& e) {
  Line line;
  line.add("event").add(e.stamp_ns).add(to_string(e.stage)).add(to_string(e.code));
  line.add(static_cast<std::int64_t>(e.sequence)).add(e.a);
  return line;
}

/// Those of a ring that are not older than `oldest_ns`, from the oldest on.
template <class Ring, class Stamp>
bool write_ring(int file, const Ring& ring, std::size_t count, Nanoseconds oldest_ns, Stamp stamp) {
  bool whole = true;
  for (std::size_t i = count - std::min(count, ring.size()); i < count; ++i) {
    const auto& item = ring[i % ring.size()];
    if (stamp(item) >= oldest_ns) whole &= line_of(item).write_to(file);
  }
  return whole;
}

std::atomic<FlightRecorder*> recorder_to_write{nullptr};
constexpr std::array kFatal{SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL};

void on_fatal_signal(int signal) {
  if (FlightRecorder* recorder = recorder_to_write.exchange(nullptr)) {
    recorder->take_in();
    static_cast<void>(recorder->write());
  }
  raise(signal);  // by its default now
}

}  // namespace

void FlightRecorder::take_in() {
  while (auto frame = inbox_.try_pop()) frames_[frame_count_++ % frames_.size()] = *frame;
}

bool FlightRecorder::write() const {
  if (!enabled()) return false;
  // A pipe that took the file's place would keep the process waiting for its reader.
  const int file = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NONBLOCK, 0644);
  if (file < 0) return false;
  struct stat found {};
  if (::fstat(file, &found) != 0 || !S_ISREG(found.st_mode)) {
    ::close(file);
    return false;
  }
  const auto when_frame = [](const FlightFrame& f) { return f.at_ns; };
  const auto when_event = [](const Event& e) { return e.stamp_ns; };
  Nanoseconds newest = 0;
  if (frame_count_ > 0) newest = frames_[(frame_count_ - 1) % frames_.size()].at_ns;
  if (event_count_ > 0) newest = std::max(newest, events_[(event_count_ - 1) % events_.size()].stamp_ns);
  bool whole =
      Line()
          .add("# frame at_ns stamp_ns sequence state matches inliers static dynamic semi_static unknown")
          .add("tx_um ty_um tz_um qx_e6 qy_e6 qz_e6 qw_e6 (T_map_camera)")
          .write_to(file);
  whole &= Line().add("# event at_ns stage code sequence a").write_to(file);
  whole &= write_ring(file, frames_, frame_count_, newest - kSpan, when_frame);
  whole &= write_ring(file, events_, event_count_, newest - kSpan, when_event);
  return ::close(file) == 0 && whole;
}

bool FlightRecorder::write_unless_just_done(Nanoseconds now) {
  if (written_ns_ != 0 && now - written_ns_ < kSpan) return true;
  written_ns_ = now;
  return write();
}

WriteOnAbort::WriteOnAbort(FlightRecorder& recorder) {
  if (!recorder.enabled()) return;
  recorder_to_write.store(&recorder);
  struct sigaction action {};
  action.sa_handler = on_fatal_signal;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  for (const int signal : kFatal) sigaction(signal, &action, nullptr);
}

WriteOnAbort::~WriteOnAbort() {
  if (recorder_to_write.exchange(nullptr) == nullptr) return;
  for (const int number : kFatal) signal(number, SIG_DFL);
}

}  // namespace stillmap
