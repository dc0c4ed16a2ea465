// SPDX-License-Identifier: Apache-2.0
// A plug-in for OpenNI2: a camera that shows the TUM log of the folder in STILLMAP_TEST_DEVICE_LOG, with
// depth in millimetres, a picture pair each 20 ms, over and over no more than once. STILLMAP_TEST_DEVICE says
// how it fails: "unregistered" (cannot register depth), "liar" (says that it does, and does not), "unplug"
// (after 5 pairs).
#define XN_NEW(type, ...) new type(__VA_ARGS__)
#define XN_DELETE(object) delete (object)
#include <Driver/OniDriverAPI.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "drivers/tum_log/tum_log.h"

namespace {

constexpr int kWidth = 64, kHeight = 48, kFps = 30;
constexpr const char* kUri = "stillmap-test-camera";

std::string behaviour() {
  const char* text = std::getenv("STILLMAP_TEST_DEVICE");
  return text == nullptr ? "" : text;
}

class Stream : public oni::driver::StreamBase {
 public:
  explicit Stream(OniSensorType sensor) : sensor_(sensor) {
    mode_ = {sensor == ONI_SENSOR_DEPTH ? ONI_PIXEL_FORMAT_DEPTH_1_MM : ONI_PIXEL_FORMAT_RGB888, kWidth,
             kHeight, kFps};
  }
  OniStatus start() override {
    running = true;
    return ONI_STATUS_OK;
  }
  void stop() override { running = false; }

  OniBool isPropertySupported(int id) override {
    return id == ONI_STREAM_PROPERTY_VIDEO_MODE || id == ONI_STREAM_PROPERTY_STRIDE ||
           id == ONI_STREAM_PROPERTY_CROPPING;
  }
  OniStatus getProperty(int id, void* data, int* size) override {
    const OniCropping whole{FALSE, 0, 0, kWidth, kHeight};
    const int stride = kWidth * bytes_per_pixel();
    if (id == ONI_STREAM_PROPERTY_VIDEO_MODE) return give(&mode_, sizeof mode_, data, size);
    if (id == ONI_STREAM_PROPERTY_STRIDE) return give(&stride, sizeof stride, data, size);
    if (id == ONI_STREAM_PROPERTY_CROPPING) return give(&whole, sizeof whole, data, size);
    return ONI_STATUS_NOT_IMPLEMENTED;
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
    frame->width = kWidth, frame->height = kHeight;
    frame->stride = kWidth * bytes_per_pixel();
    frame->dataSize = frame->stride * kHeight;
    frame->croppingEnabled = FALSE;
    frame->cropOriginX = frame->cropOriginY = 0;
    std::memcpy(frame->data, pixels, static_cast<std::size_t>(frame->dataSize));
    raiseNewFrame(frame);
    getServices().releaseFrame(frame);
  }
  std::atomic<bool> running{false};

 private:
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
    modes_[0] = {ONI_PIXEL_FORMAT_RGB888, kWidth, kHeight, kFps};
    modes_[1] = {ONI_PIXEL_FORMAT_DEPTH_1_MM, kWidth, kHeight, kFps};
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
    stillmap::TumLog log(std::getenv("STILLMAP_TEST_DEVICE_LOG"), kWidth, kHeight);
    if (!log.open().ok() || !log.start().ok()) return;
    while (!end_ &&
           !(colour_ != nullptr && depth_ != nullptr && colour_.load()->running && depth_.load()->running))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    std::vector<stillmap::Bgr> colour(kWidth * kHeight);
    std::vector<std::uint16_t> depth(kWidth * kHeight);
    stillmap::FrameSlot slot;
    slot.colour = {colour.data(), kWidth, kHeight, kWidth};
    slot.depth = {depth.data(), kWidth, kHeight, kWidth};
    for (int index = 1; !end_ && log.grab(slot, 0).status == stillmap::GrabStatus::Frame; ++index) {
      for (stillmap::Bgr& p : colour) std::swap(p.b, p.r);
      busy_ = true;
      if (Stream* s = depth_; s != nullptr && !end_)
        s->show(depth.data(), index, static_cast<std::uint64_t>(slot.depth_ns / 1000));
      if (Stream* s = colour_; s != nullptr && !end_)
        s->show(colour.data(), index, static_cast<std::uint64_t>(slot.colour_ns / 1000));
      busy_ = false;
      if (behaviour() == "unplug" && index == 5) unplug_();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
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
    return new Device([this] {
      deviceDisconnected(&info_);
      deviceConnected(&info_);  // and plugged in again
    });
  }
  void deviceClose(oni::driver::DeviceBase* device) override { delete device; }
  void shutdown() override {}

 private:
  OniDeviceInfo info_{};
};

}  // namespace

ONI_EXPORT_DRIVER(Driver)
