// SPDX-License-Identifier: Apache-2.0
// A plug-in for OpenNI2: a camera that shows the TUM log of the folder in STILLMAP_TEST_DEVICE_LOG once, with
// depth in millimetres, once its two streams are in sync. STILLMAP_TEST_DEVICE_PICTURES may say "WIDTH HEIGHT
// UNITS PERIOD": the log's depth units in a metre, and the ms from one pair to the next. STILLMAP_TEST_DEVICE
// says how it fails: "unregistered" (cannot register depth), "liar" (says that it does, and does not),
// "unplug" (after 5 pairs), "dies" (after 5 pairs, and cannot be opened again), "lensless" (does not tell its
// field of view), "unsynced" (cannot keep its streams in sync).
#define XN_NEW(type, ...) new type(__VA_ARGS__)
#define XN_DELETE(object) delete (object)
#include <Driver/OniDriverAPI.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/tum_log/tum_log.h"

namespace {

constexpr int kFps = 30;
constexpr const char* kUri = "stillmap-test-camera";

struct Pictures {
  int width = 64, height = 48, units_per_m = 1000, period_ms = 20;
  std::size_t pixels() const { return static_cast<std::size_t>(width * height); }
};
const Pictures& pictures() {
  static const Pictures chosen = [] {
    Pictures p;
    const char* text = std::getenv("STILLMAP_TEST_DEVICE_PICTURES");
    if (text != nullptr) std::istringstream(text) >> p.width >> p.height >> p.units_per_m >> p.period_ms;
    return p;
  }();
  return chosen;
}

std::string behaviour() {
  const char* text = std::getenv("STILLMAP_TEST_DEVICE");
  return text == nullptr ? "" : text;
}

std::atomic<bool> g_in_sync{false};

class Stream : public oni::driver::StreamBase {
 public:
  explicit Stream(OniSensorType sensor) : sensor_(sensor) {
    mode_ = {sensor == ONI_SENSOR_DEPTH ? ONI_PIXEL_FORMAT_DEPTH_1_MM : ONI_PIXEL_FORMAT_RGB888,
             pictures().width, pictures().height, kFps};
  }
  OniStatus start() override {
    running = true;
    return ONI_STATUS_OK;
  }
  void stop() override { running = false; }

  OniBool isPropertySupported(int id) override {
    const bool lens = id == ONI_STREAM_PROPERTY_HORIZONTAL_FOV || id == ONI_STREAM_PROPERTY_VERTICAL_FOV;
    if (lens) return behaviour() != "lensless";
    return id == ONI_STREAM_PROPERTY_VIDEO_MODE || id == ONI_STREAM_PROPERTY_STRIDE ||
           id == ONI_STREAM_PROPERTY_CROPPING;
  }
  OniStatus getProperty(int id, void* data, int* size) override {
    const OniCropping whole{FALSE, 0, 0, pictures().width, pictures().height};
    const int stride = pictures().width * bytes_per_pixel();
    if (id == ONI_STREAM_PROPERTY_VIDEO_MODE) return give(&mode_, sizeof mode_, data, size);
    if (id == ONI_STREAM_PROPERTY_STRIDE) return give(&stride, sizeof stride, data, size);
    if (id == ONI_STREAM_PROPERTY_CROPPING) return give(&whole, sizeof whole, data, size);
    if (!isPropertySupported(id)) return ONI_STATUS_NOT_IMPLEMENTED;
    const int side = id == ONI_STREAM_PROPERTY_HORIZONTAL_FOV ? pictures().width : pictures().height;
    const auto angle = static_cast<float>(2 * std::atan(side / 2.0 / focal_px()));
    return give(&angle, sizeof angle, data, size);
  }
  OniStatus setProperty(int id, const void* data, int size) override {
    if (id != ONI_STREAM_PROPERTY_VIDEO_MODE || size != static_cast<int>(sizeof mode_))
      return ONI_STATUS_NOT_IMPLEMENTED;
    return std::memcmp(data, &mode_, sizeof mode_) == 0 ? ONI_STATUS_OK : ONI_STATUS_BAD_PARAMETER;
  }
  void notifyAllProperties() override {
    for (const int id :
         {ONI_STREAM_PROPERTY_VIDEO_MODE, ONI_STREAM_PROPERTY_STRIDE, ONI_STREAM_PROPERTY_CROPPING}) {
      std::array<char, 64> data{};
      int size = static_cast<int>(data.size());
      getProperty(id, data.data(), &size);
      raisePropertyChanged(id, data.data(), size);
    }
  }

  void show(const void* pixels, int index, std::uint64_t stamp_us) {
    if (!running) return;
    OniFrame* frame = getServices().acquireFrame();
    if (frame == nullptr) return;
    frame->frameIndex = index;
    frame->timestamp = stamp_us;
    frame->sensorType = sensor_;
    frame->videoMode = mode_;
    frame->width = pictures().width, frame->height = pictures().height;
    frame->stride = pictures().width * bytes_per_pixel();
    frame->dataSize = frame->stride * pictures().height;
    frame->croppingEnabled = FALSE;
    frame->cropOriginX = frame->cropOriginY = 0;
    std::memcpy(frame->data, pixels, static_cast<std::size_t>(frame->dataSize));
    raiseNewFrame(frame);
    getServices().releaseFrame(frame);
  }
  std::atomic<bool> running{false};

 private:
  static double focal_px() { return 0.8 * pictures().width; }
  int bytes_per_pixel() const { return sensor_ == ONI_SENSOR_DEPTH ? 2 : 3; }
  static OniStatus give(const void* from, std::size_t bytes, void* to, int* size) {
    if (*size < static_cast<int>(bytes)) return ONI_STATUS_BAD_PARAMETER;
    std::memcpy(to, from, bytes);
    *size = static_cast<int>(bytes);
    return ONI_STATUS_OK;
  }
  OniSensorType sensor_;
  OniVideoMode mode_{};
};

class Device : public oni::driver::DeviceBase {
 public:
  explicit Device(std::function<void()> unplug) : unplug_(std::move(unplug)) {
    modes_[0] = {ONI_PIXEL_FORMAT_RGB888, pictures().width, pictures().height, kFps};
    modes_[1] = {ONI_PIXEL_FORMAT_DEPTH_1_MM, pictures().width, pictures().height, kFps};
    sensors_[0] = {ONI_SENSOR_COLOR, 1, &modes_[0]};
    sensors_[1] = {ONI_SENSOR_DEPTH, 1, &modes_[1]};
    thread_ = std::thread([this] { play(); });
  }
  ~Device() override {
    end_ = true;
    thread_.join();
  }
  OniStatus getSensorInfoList(OniSensorInfo** sensors, int* count) override {
    *sensors = sensors_.data();
    *count = 2;
    return ONI_STATUS_OK;
  }
  oni::driver::StreamBase* createStream(OniSensorType sensor) override {
    auto* stream = new Stream(sensor);
    (sensor == ONI_SENSOR_DEPTH ? depth_ : colour_) = stream;
    return stream;
  }
  void destroyStream(oni::driver::StreamBase* stream) override {
    while (busy_) std::this_thread::yield();
    if (colour_ == stream) colour_ = nullptr;
    if (depth_ == stream) depth_ = nullptr;
    delete stream;
  }
  OniBool isPropertySupported(int id) override { return id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION; }
  OniBool isImageRegistrationModeSupported(OniImageRegistrationMode mode) override {
    return mode == ONI_IMAGE_REGISTRATION_OFF || behaviour() != "unregistered";
  }
  OniStatus setProperty(int id, const void* data, int) override {
    if (id != ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION) return ONI_STATUS_NOT_IMPLEMENTED;
    if (behaviour() != "liar") std::memcpy(&registration_, data, sizeof registration_);
    return ONI_STATUS_OK;
  }
  OniStatus getProperty(int id, void* data, int* size) override {
    if (id != ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION) return ONI_STATUS_NOT_IMPLEMENTED;
    std::memcpy(data, &registration_, sizeof registration_);
    *size = sizeof registration_;
    return ONI_STATUS_OK;
  }

 private:
  void play() {
    stillmap::TumLog log(std::getenv("STILLMAP_TEST_DEVICE_LOG"), pictures().width, pictures().height);
    if (!log.open().ok() || !log.start().ok()) return;
    while (!end_ && !(colour_ != nullptr && depth_ != nullptr && colour_.load()->running &&
                      depth_.load()->running && (g_in_sync || behaviour() == "unsynced")))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    std::vector<stillmap::Bgr> colour(pictures().pixels());
    std::vector<std::uint16_t> depth(pictures().pixels());
    stillmap::FrameSlot slot;
    slot.colour = {colour.data(), pictures().width, pictures().height, pictures().width};
    slot.depth = {depth.data(), pictures().width, pictures().height, pictures().width};
    for (int index = 1; !end_ && log.grab(slot, 0).status == stillmap::GrabStatus::Frame; ++index) {
      for (stillmap::Bgr& p : colour) std::swap(p.b, p.r);
      for (std::uint16_t& d : depth) d = static_cast<std::uint16_t>(d * 1000 / pictures().units_per_m);
      busy_ = true;
      if (Stream* s = depth_; s != nullptr && !end_)
        s->show(depth.data(), index, static_cast<std::uint64_t>(slot.depth_ns / 1000));
      if (Stream* s = colour_; s != nullptr && !end_)
        s->show(colour.data(), index, static_cast<std::uint64_t>(slot.colour_ns / 1000));
      busy_ = false;
      if (behaviour() == "unplug" && index == 5) unplug_();
      if (behaviour() == "dies" && index == 5) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(pictures().period_ms));
    }
  }

  std::function<void()> unplug_;
  std::array<OniVideoMode, 2> modes_{};
  std::array<OniSensorInfo, 2> sensors_{};
  std::atomic<Stream*> colour_{nullptr}, depth_{nullptr};
  std::atomic<bool> end_{false}, busy_{false};
  OniImageRegistrationMode registration_ = ONI_IMAGE_REGISTRATION_OFF;
  std::thread thread_;
};

class Driver : public oni::driver::DriverBase {
 public:
  explicit Driver(OniDriverServices* services) : DriverBase(services) {
    std::strcpy(info_.uri, kUri);
    std::strcpy(info_.vendor, "Stillmap");
    std::strcpy(info_.name, "Test camera");
  }
  OniStatus initialize(oni::driver::DeviceConnectedCallback connected,
                       oni::driver::DeviceDisconnectedCallback disconnected,
                       oni::driver::DeviceStateChangedCallback changed, void* cookie) override {
    DriverBase::initialize(connected, disconnected, changed, cookie);
    deviceConnected(&info_);
    return ONI_STATUS_OK;
  }
  oni::driver::DeviceBase* deviceOpen(const char*, const char*) override {
    if (behaviour() == "dies" && std::exchange(opened_, true)) return nullptr;
    return new Device([this] {
      deviceDisconnected(&info_);
      deviceConnected(&info_);  // and plugged in again
    });
  }
  void* enableFrameSync(oni::driver::StreamBase**, int) override {
    if (behaviour() == "unsynced") return nullptr;
    g_in_sync = true;
    return this;
  }
  void disableFrameSync(void*) override { g_in_sync = false; }
  void deviceClose(oni::driver::DeviceBase* device) override { delete device; }
  void shutdown() override {}

 private:
  OniDeviceInfo info_{};
  bool opened_ = false;
};

}  // namespace

ONI_EXPORT_DRIVER(Driver)
