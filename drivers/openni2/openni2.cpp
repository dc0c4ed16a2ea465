// SPDX-License-Identifier: Apache-2.0
// The module libstillmap_driver_openni2.so: cameras and recordings that OpenNI2 opens.
#include <OpenNI.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <optional>
#include <utility>

#include "drivers/arrivals.h"
#include "drivers/camera_module.h"

namespace stillmap {

namespace {

constexpr Nanoseconds kMicrosecond = 1000, kMillisecond = 1'000'000;

/// The library is begun with the first use and stays until the process ends.
bool library_is_ready() {
  static const bool ready = openni::OpenNI::initialize() == openni::STATUS_OK;
  return ready;
}

std::string library_words() {
  std::string words = openni::OpenNI::getExtendedError();
  std::replace(words.begin(), words.end(), '\n', ' ');
  while (!words.empty() && words.back() == ' ') words.pop_back();
  return words.empty() ? "no reason given" : words;
}

struct KnownFormat {
  openni::PixelFormat theirs;
  PixelFormat ours;
};
constexpr KnownFormat kColours[]{{openni::PIXEL_FORMAT_RGB888, PixelFormat::Rgb},
                                 {openni::PIXEL_FORMAT_YUYV, PixelFormat::Yuyv},
                                 {openni::PIXEL_FORMAT_GRAY8, PixelFormat::Grey}};
/// Depth comes in millimetres or in tenths of one.
constexpr KnownFormat kMillimetres[]{{openni::PIXEL_FORMAT_DEPTH_1_MM, PixelFormat::Depth16}};
constexpr KnownFormat kTenths[]{{openni::PIXEL_FORMAT_DEPTH_100_UM, PixelFormat::Depth16}};

std::span<const KnownFormat> formats_of(const CameraRequest& request, bool depth) {
  if (!depth) return kColours;
  if (request.depth_units_per_m == 1000) return kMillimetres;
  if (request.depth_units_per_m == 10000) return kTenths;
  return {};
}

/// One device, shared by its two streams.
class Camera : public openni::OpenNI::DeviceDisconnectedListener {
 public:
  explicit Camera(CameraRequest request) : request_(std::move(request)) {}
  ~Camera() override {
    openni::OpenNI::removeDeviceDisconnectedListener(this);
    device_.close();
  }
  Camera(const Camera&) = delete;
  Camera& operator=(const Camera&) = delete;

  Status open() {
    if (device_.isValid()) return {};
    if (!library_is_ready()) return refused("OpenNI2 cannot be used (" + library_words() + ")");
    const char* uri = request_.device.empty() ? openni::ANY_DEVICE : request_.device.c_str();
    if (device_.open(uri) != openni::STATUS_OK) {
      if (request_.device.ends_with(".oni"))
        return refused("is not there, or no recording that was brought to its end",
                       ExitCode::UnreadableInput);
      return refused("cannot be opened (" + library_words() +
                     "); `stillmap devices` lists what is there, and another program may be using it");
    }
    uri_ = device_.getDeviceInfo().getUri();
    openni::OpenNI::addDeviceDisconnectedListener(this);
    return {};
  }

  /// Once both streams are open: the device registers depth to colour, and says so when asked; or, where the
  /// profile describes the depth camera, it does not.
  Status set_registration() {
    if (is_file()) return {};
    const auto wanted =
        request_.register_depth ? openni::IMAGE_REGISTRATION_DEPTH_TO_COLOR : openni::IMAGE_REGISTRATION_OFF;
    const bool set = device_.isImageRegistrationModeSupported(wanted) &&
                     device_.setImageRegistrationMode(wanted) == openni::STATUS_OK &&
                     device_.getImageRegistrationMode() == wanted;
    if (set || !request_.register_depth) return {};
    return refused(
        "does not register depth to colour by itself; describe its depth camera in the profile "
        "(camera.depth.width, height, fx, fy, cx, cy, T_colour_depth), and it is done here");
  }
  /// Not every device can; unsynchronised pictures are paired by their stamps all the same.
  void set_sync() {
    if (!is_file()) device_.setDepthColorSyncEnabled(true);
  }

  void onDeviceDisconnected(const openni::DeviceInfo* info) override {
    if (uri_ == info->getUri()) gone_.store(true, std::memory_order_release);
  }
  bool gone() const { return gone_.load(std::memory_order_acquire); }
  bool is_file() const { return device_.isFile(); }
  openni::Device& device() { return device_; }
  const CameraRequest& request() const { return request_; }
  std::string name() const { return "openni2:" + request_.device; }
  Error refused(const std::string& what, ExitCode code = ExitCode::RunFailed) const {
    return {code, name() + ": " + what};
  }

  /// A device's clock begins anew with each plugging in: its stamps are moved to the monotonic clock by the
  /// first picture's arrival, alike for both streams. A recording's stay as they are.
  Nanoseconds stamp(std::uint64_t device_us) {
    const Nanoseconds device_ns = static_cast<Nanoseconds>(device_us) * kMicrosecond;
    if (is_file()) return device_ns;
    if (!clock_offset_ns_) clock_offset_ns_ = monotonic_now() - device_ns;
    return device_ns + *clock_offset_ns_;
  }

 private:
  CameraRequest request_;
  openni::Device device_;
  std::string uri_;
  std::atomic<bool> gone_{false};
  std::optional<Nanoseconds> clock_offset_ns_;
};

/// The library takes a block from the heap for each picture that is given back to it, so that is done on its
/// own thread, which tells of each new one. A camera's pictures are read there, too, into the places that
/// come back; a recording's on the caller's, since it shows the next one only when it is asked for, into
/// places that were emptied there.
class Openni2Stream : public PictureStream, public openni::VideoStream::NewFrameListener {
 public:
  Openni2Stream(std::shared_ptr<Camera> camera, bool depth) : camera_(std::move(camera)), depth_(depth) {}
  ~Openni2Stream() override {
    Openni2Stream::stop();
    stream_.destroy();
  }
  Openni2Stream(const Openni2Stream&) = delete;
  Openni2Stream& operator=(const Openni2Stream&) = delete;

  Status open() override {
    if (Status s = camera_->open(); !s.ok()) return s;
    if (stream_.create(camera_->device(), sensor()) != openni::STATUS_OK)
      return camera_->refused("has no " + kind() + " (" + library_words() + ")");
    if (Status s = camera_->is_file() ? take_recorded_mode() : set_mode(); !s.ok()) return s;
    if (camera_->is_file()) {
      recorded_ = camera_->device().getPlaybackControl()->getNumberOfFrames(stream_);
    } else {
      stream_.setMirroringEnabled(false);
    }
    // Depth is opened second.
    return depth_ ? camera_->set_registration() : Status{};
  }

  StreamInfo describe() const override { return info_; }

  /// Once open.
  std::optional<DeviceLens> lens() const {
    const double across = stream_.getHorizontalFieldOfView(), down = stream_.getVerticalFieldOfView();
    const auto usable = [](double angle) {
      return angle > 0 && angle < 3;
    };  // radians; 0 where it is unknown
    if (!usable(across) || !usable(down)) return {};
    return DeviceLens{info_.width / 2.0 / std::tan(across / 2), info_.height / 2.0 / std::tan(down / 2)};
  }

  Status start() override {
    if (openni::PlaybackControl* playback = camera_->device().getPlaybackControl();
        camera_->is_file() && playback != nullptr) {
      playback->setRepeatEnabled(false);
      playback->setSpeed(-1);  // each picture waits to be read; at any other speed some are left out
    }
    for (std::size_t i = 0; i < kFrames; ++i) {
      if (camera_->is_file()) {
        arrivals_.arrive(i);
      } else {
        arrivals_.release(i);
      }
    }
    listening_ = stream_.addNewFrameListener(this) == openni::STATUS_OK;
    if (stream_.start() != openni::STATUS_OK)
      return camera_->refused("cannot stream " + kind() + " (" + library_words() + ")");
    // Colour is started second, and both must run for that.
    if (!depth_) camera_->set_sync();
    return {};
  }

  PeekStatus peek(HeldPicture& out, Nanoseconds deadline_ns) override {
    if (!held_frame_) {
      const PeekStatus status = camera_->is_file() ? read_recorded() : take_arrived(deadline_ns);
      if (status != PeekStatus::Picture) return status;
    }
    out = held_;
    return PeekStatus::Picture;
  }

  void release() override {
    if (!held_frame_) return;
    arrivals_.release(*held_frame_);
    held_frame_.reset();
  }

  void stop() override {
    // Returns when the library's thread is done with it.
    if (std::exchange(listening_, false)) stream_.removeNewFrameListener(this);
    if (stream_.isValid()) stream_.stop();
    for (openni::VideoFrameRef& frame : frames_) frame.release();
    arrivals_.clear();
    spare_.reset();
    held_frame_.reset();
  }

  /// The library's thread. Where every place is taken, a camera's picture is passed over, as its index tells.
  void onNewFrame(openni::VideoStream&) override {
    if (camera_->is_file()) {
      while (const auto place = arrivals_.released()) {
        frames_[*place].release();
        arrivals_.arrive(*place);
      }
      return;
    }
    if (!spare_) spare_ = arrivals_.released();
    if (!spare_ || !has_picture(0) || stream_.readFrame(&frames_[*spare_]) != openni::STATUS_OK) return;
    arrivals_.arrive(*spare_);
    spare_.reset();
  }

 private:
  static constexpr std::size_t kFrames = 4;

  bool has_picture(int timeout_ms) {
    openni::VideoStream* stream = &stream_;
    int ready = 0;
    return openni::OpenNI::waitForAnyStream(&stream, 1, &ready, timeout_ms) == openni::STATUS_OK;
  }

  PeekStatus take_arrived(Nanoseconds deadline_ns) {
    for (;;) {
      if (camera_->gone()) return PeekStatus::Lost;
      if (const auto place = arrivals_.arrived()) {
        hold(*place);
        return PeekStatus::Picture;
      }
      if (!arrivals_.wait(deadline_ns)) return camera_->gone() ? PeekStatus::Lost : PeekStatus::Timeout;
    }
  }

  /// Whatever the deadline: each time it is asked, the library shows one more, and keeps the newest only.
  PeekStatus read_recorded() {
    constexpr int kPatience_ms = 500, kMaxSilences = 4;
    if (last_index_ >= recorded_) return PeekStatus::EndOfStream;
    while (!spare_ && !(spare_ = arrivals_.arrived())) {
      if (!arrivals_.wait(monotonic_now() + kPatience_ms * kMillisecond)) return PeekStatus::Timeout;
    }
    if (!has_picture(kPatience_ms))
      return ++silences_ < kMaxSilences ? PeekStatus::Timeout : PeekStatus::Lost;
    if (stream_.readFrame(&frames_[*spare_]) != openni::STATUS_OK) return PeekStatus::Lost;
    silences_ = 0;
    hold(*spare_);
    spare_.reset();
    return PeekStatus::Picture;
  }

  void hold(std::size_t index) {
    const openni::VideoFrameRef& frame = frames_[index];
    held_frame_ = index;
    const int step = frame.getFrameIndex() - last_index_;
    // A recording counts from 1, a camera from where it likes.
    held_.missed =
        (last_index_ > 0 || camera_->is_file()) && step > 1 ? static_cast<std::uint32_t>(step - 1) : 0;
    last_index_ = frame.getFrameIndex();
    held_.stamp_ns = camera_->stamp(frame.getTimestamp());
    held_.picture = {
        info_.format,
        frame.getWidth(),
        frame.getHeight(),
        {{{static_cast<const std::byte*>(frame.getData()), static_cast<std::size_t>(frame.getDataSize()),
           static_cast<std::size_t>(frame.getStrideInBytes())}}}};
  }

  openni::SensorType sensor() const { return depth_ ? openni::SENSOR_DEPTH : openni::SENSOR_COLOR; }
  std::string kind() const { return depth_ ? "depth" : "colour"; }

  void take_mode(const openni::VideoMode& mode, PixelFormat format) {
    info_ = {.name = camera_->name(),
             .format = format,
             .width = mode.getResolutionX(),
             .height = mode.getResolutionY(),
             .fps = static_cast<double>(mode.getFps()),
             .is_log = camera_->is_file()};
  }

  Status wrong_format(const std::string& what) const {
    const CameraRequest& r = camera_->request();
    return camera_->refused(
        "has no " + kind() + " of " + std::to_string(r.width) + "x" + std::to_string(r.height) + " px at " +
            std::to_string(std::lround(r.fps)) + " Hz" +
            (depth_ || r.colour_format.empty() ? "" : " as " + r.colour_format) + what +
            "; change camera.width, camera.height, camera.fps and camera.colour_format, and "
            "let camera.depth_units_per_m be 1000 or 10000",
        ExitCode::WrongConfig);
  }

  Status take_recorded_mode() {
    const openni::VideoMode mode = stream_.getVideoMode();
    for (const KnownFormat& format : formats_of(camera_->request(), depth_)) {
      if (mode.getPixelFormat() != format.theirs) continue;
      take_mode(mode, format.ours);
      return {};
    }
    return wrong_format(" in a format that can be read");
  }

  Status set_mode() {
    const CameraRequest& r = camera_->request();
    const openni::Array<openni::VideoMode>& modes = stream_.getSensorInfo().getSupportedVideoModes();
    std::string sizes;
    for (const KnownFormat& format : formats_of(r, depth_)) {
      if (!depth_ && !r.colour_format.empty() && r.colour_format != name_of(format.ours)) continue;
      for (int i = 0; i < modes.getSize(); ++i) {
        const openni::VideoMode& mode = modes[i];
        if (mode.getPixelFormat() != format.theirs) continue;
        if (mode.getResolutionX() != r.width || mode.getResolutionY() != r.height ||
            mode.getFps() != std::lround(r.fps)) {
          sizes.append(" ").append(std::to_string(mode.getResolutionX())).append("x");
          sizes.append(std::to_string(mode.getResolutionY()))
              .append("@")
              .append(std::to_string(mode.getFps()));
          continue;
        }
        if (stream_.setVideoMode(mode) != openni::STATUS_OK) continue;
        take_mode(mode, format.ours);
        return {};
      }
    }
    return wrong_format(sizes.empty() ? "" : " (it has:" + sizes + ")");
  }

  std::shared_ptr<Camera> camera_;
  bool depth_;
  openni::VideoStream stream_;
  std::array<openni::VideoFrameRef, kFrames> frames_;
  Arrivals arrivals_;                 // of places in `frames_`
  std::optional<std::size_t> spare_;  // the thread that reads: a place for the next picture
  StreamInfo info_;
  HeldPicture held_;
  std::optional<std::size_t> held_frame_;  // a place
  int last_index_ = 0, recorded_ = 0, silences_ = 0;
  bool listening_ = false;
};

class Openni2Module : public CameraModule {
 public:
  StreamPair make(const CameraRequest& request) override {
    const auto camera = std::make_shared<Camera>(request);
    return {std::make_unique<Openni2Stream>(camera, false), std::make_unique<Openni2Stream>(camera, true)};
  }
  std::optional<DeviceLens> lens(const CameraRequest& request) override {
    Openni2Stream colour(std::make_shared<Camera>(request), false);
    if (!colour.open().ok()) return {};
    return colour.lens();
  }
  std::vector<FoundCamera> list() override {
    std::vector<FoundCamera> found;
    if (!library_is_ready()) return found;
    openni::Array<openni::DeviceInfo> devices;
    openni::OpenNI::enumerateDevices(&devices);
    for (int i = 0; i < devices.getSize(); ++i)
      found.push_back(
          {devices[i].getUri(), std::string(devices[i].getVendor()) + " " + devices[i].getName()});
    return found;
  }
};

}  // namespace

}  // namespace stillmap

extern "C" __attribute__((visibility("default"))) stillmap::CameraModule* stillmap_camera_module() {
  static stillmap::Openni2Module module;
  return &module;
}
