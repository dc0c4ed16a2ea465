// SPDX-License-Identifier: Apache-2.0
// The module libstillmap_driver_libcamera.so: colour of the cameras that libcamera drives.
#include <errno.h>
#include <libcamera/libcamera.h>
#include <linux/dma-buf.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <optional>
#include <utility>

#include "drivers/arrivals.h"
#include "drivers/camera_module.h"

namespace stillmap {

namespace {

/// The library is begun with the first use and stays until the process ends; null where it cannot be.
libcamera::CameraManager* manager() {
  // Before its first word: it tells its version, and what is unknown of a sensor, each time.
  [[maybe_unused]] static const int quiet = setenv("LIBCAMERA_LOG_LEVELS", "*:ERROR", 0);
  static libcamera::CameraManager cameras;
  static const bool ready = cameras.start() == 0;
  return ready ? &cameras : nullptr;
}

struct KnownFormat {
  libcamera::PixelFormat theirs;
  PixelFormat ours;
};
/// The best first: uncompressed before JPEG, colour before grey. Their names go by the significance of a
/// word's bytes: RGB888 lies in memory with blue first.
const std::array<KnownFormat, 6> kFormats{{{libcamera::formats::YUYV, PixelFormat::Yuyv},
                                           {libcamera::formats::NV12, PixelFormat::Nv12},
                                           {libcamera::formats::RGB888, PixelFormat::Bgr},
                                           {libcamera::formats::BGR888, PixelFormat::Rgb},
                                           {libcamera::formats::MJPEG, PixelFormat::Mjpg},
                                           {libcamera::formats::R8, PixelFormat::Grey}}};

/// A buffer of the camera in this process's memory, from open to the stream's end.
class MappedBuffer {
 public:
  /// False where the kernel gives no memory for it.
  bool map(const libcamera::FrameBuffer& buffer) {
    for (const libcamera::FrameBuffer::Plane& plane : buffer.planes()) {
      const int file = plane.fd.get();
      Area& area = areas_[file];
      if (area.start == nullptr) {
        area.bytes = static_cast<std::size_t>(std::max<off_t>(lseek(file, 0, SEEK_END), 0));
        void* start = mmap(nullptr, area.bytes, PROT_READ, MAP_SHARED, file, 0);
        if (start == MAP_FAILED) return false;
        area.start = static_cast<const std::byte*>(start);
      }
      planes_.push_back({area.start + plane.offset, plane.length});
    }
    return !planes_.empty();
  }
  MappedBuffer() = default;
  MappedBuffer(MappedBuffer&&) = default;
  MappedBuffer& operator=(MappedBuffer&&) = delete;
  ~MappedBuffer() {
    for (const auto& [file, area] : areas_) {
      if (area.start != nullptr) munmap(const_cast<std::byte*>(area.start), area.bytes);
    }
  }

  /// Where caches do not see what devices write, the kernel must know when the processor reads.
  void begin_read() const { sync(DMA_BUF_SYNC_START); }
  void end_read() const { sync(DMA_BUF_SYNC_END); }

  struct Plane {
    const std::byte* start = nullptr;
    std::size_t bytes = 0;
  };
  const std::vector<Plane>& planes() const { return planes_; }

 private:
  struct Area {
    const std::byte* start = nullptr;
    std::size_t bytes = 0;
  };
  void sync(std::uint64_t edge) const {
    for (const auto& [file, area] : areas_) {
      dma_buf_sync request{edge | DMA_BUF_SYNC_READ};
      ioctl(file, DMA_BUF_IOCTL_SYNC, &request);
    }
  }
  std::map<int, Area> areas_;  // by file: several planes may lie in one
  std::vector<Plane> planes_;
};

class LibcameraStream : public PictureStream {
 public:
  explicit LibcameraStream(CameraRequest request) : request_(std::move(request)) {}
  ~LibcameraStream() override {
    LibcameraStream::stop();
    buffers_.clear();
    requests_.clear();
    if (camera_ != nullptr) {
      camera_->requestCompleted.disconnect(this);
      camera_->disconnected.disconnect(this);
      allocator_.reset();
      camera_->release();
    }
  }
  LibcameraStream(const LibcameraStream&) = delete;
  LibcameraStream& operator=(const LibcameraStream&) = delete;

  Status open() override {
    if (Status s = find(); !s.ok()) return s;
    if (Status s = set_format(); !s.ok()) return s;
    if (Status s = map_buffers(); !s.ok()) return s;
    camera_->requestCompleted.connect(this, &LibcameraStream::on_completed);
    camera_->disconnected.connect(this, &LibcameraStream::on_gone);
    return {};
  }

  StreamInfo describe() const override { return info_; }

  Status start() override {
    libcamera::ControlList controls(camera_->controls());
    const auto duration = camera_->controls().find(&libcamera::controls::FrameDurationLimits);
    if (duration != camera_->controls().end()) {
      const std::int64_t period_us = std::lround(1e6 / request_.fps);
      controls.set(libcamera::controls::FrameDurationLimits,
                   libcamera::Span<const std::int64_t, 2>({period_us, period_us}));
      info_.fps = request_.fps;
    }
    if (camera_->start(&controls) != 0) return refused("cannot stream; is another program using the camera?");
    streaming_.store(true, std::memory_order_release);
    last_sequence_.reset();
    with_camera_ = requests_.size();
    for (const auto& request : requests_) {
      if (!queue(*request)) return refused("takes no buffer; unplug the camera and plug it in again");
    }
    return {};
  }

  PeekStatus peek(HeldPicture& out, Nanoseconds deadline_ns) override {
    while (held_request_ == nullptr) {
      if (gone_.load(std::memory_order_acquire)) return PeekStatus::Lost;
      if (const auto index = arrivals_.arrived()) {
        if (take(*requests_[*index])) continue;
        arrivals_.release(*index);
        return PeekStatus::Corrupt;
      }
      if (!arrivals_.wait(deadline_ns)) return PeekStatus::Timeout;
    }
    out = held_;
    return PeekStatus::Picture;
  }

  void release() override {
    if (held_request_ == nullptr) return;
    const std::size_t index = index_of(*std::exchange(held_request_, nullptr));
    buffers_[index].end_read();
    arrivals_.release(index);
    held_.missed = 0;
  }

  void stop() override {
    if (!streaming_.exchange(false)) return;
    if (held_request_ != nullptr) buffers_[index_of(*held_request_)].end_read();
    held_request_ = nullptr;
    held_.missed = 0;
    camera_->stop();  // returns when the library's thread is done with this camera
    arrivals_.clear();
    for (const auto& request : requests_) request->reuse(libcamera::Request::ReuseBuffers);
  }

 private:
  static constexpr unsigned kBuffers = 4;

  Error refused(const std::string& what, ExitCode code = ExitCode::RunFailed) const {
    return {code, "libcamera:" + request_.device + ": " + what};
  }

  Status find() {
    if (manager() == nullptr) return refused("libcamera cannot be used; its words are above");
    const auto cameras = manager()->cameras();
    const auto at = std::find_if(cameras.begin(), cameras.end(), [&](const auto& camera) {
      return request_.device.empty() || camera->id() == request_.device;
    });
    if (at == cameras.end())
      return refused(
          "no such camera; `stillmap devices` lists what is there, and a camera that is missing "
          "there needs the package libcamera-ipa or another boot configuration");
    const int error = (*at)->acquire();
    if (error != 0)
      return refused(error == -EBUSY ? "another program uses it"
                                     : std::string("cannot be opened (") + std::strerror(-error) + ")");
    camera_ = *at;
    return {};
  }

  Status set_format() {
    configuration_ = camera_->generateConfiguration({libcamera::StreamRole::VideoRecording});
    if (configuration_ == nullptr || configuration_->empty()) return refused("gives no pictures");
    libcamera::StreamConfiguration& stream = configuration_->at(0);
    const std::vector<libcamera::PixelFormat> offered = stream.formats().pixelformats();
    const auto width = static_cast<unsigned>(request_.width), height = static_cast<unsigned>(request_.height);
    std::string nearest;
    for (const KnownFormat& known : kFormats) {
      if (!request_.colour_format.empty() && request_.colour_format != name_of(known.ours)) continue;
      if (std::find(offered.begin(), offered.end(), known.theirs) == offered.end()) continue;
      stream.pixelFormat = known.theirs;
      stream.size = {width, height};
      stream.bufferCount = kBuffers;
      const bool valid = configuration_->validate() != libcamera::CameraConfiguration::Invalid;
      if (!valid || stream.pixelFormat != known.theirs || stream.size != libcamera::Size(width, height)) {
        nearest += (nearest.empty() ? "" : ", ") + stream.toString();
        continue;
      }
      if (camera_->configure(configuration_.get()) != 0) return refused("refuses to be configured");
      info_ = {.name = "libcamera:" + camera_->id(),
               .format = known.ours,
               .width = request_.width,
               .height = request_.height,
               .monotonic_stamps = true};
      return {};
    }
    return refused("no colour of " + std::to_string(width) + "x" + std::to_string(height) +
                       " px in a format that can be read" +
                       (request_.colour_format.empty() ? "" : " as " + request_.colour_format) +
                       (nearest.empty() ? "" : "; nearest: " + nearest) +
                       "; change camera.width, camera.height and camera.colour_format, or the camera",
                   ExitCode::WrongConfig);
  }

  Status map_buffers() {
    libcamera::Stream* stream = configuration_->at(0).stream();
    allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
    if (allocator_->allocate(stream) < 0) return refused("the driver gives no buffers; free some memory");
    for (const auto& buffer : allocator_->buffers(stream)) {
      auto request = camera_->createRequest(requests_.size());
      MappedBuffer mapped;
      if (request == nullptr || request->addBuffer(stream, buffer.get()) != 0 || !mapped.map(*buffer))
        return refused("a buffer cannot be mapped; free some memory");
      buffers_.push_back(std::move(mapped));
      requests_.push_back(std::move(request));
    }
    return {};
  }

  static std::size_t index_of(const libcamera::Request& request) {
    return static_cast<std::size_t>(request.cookie());
  }

  /// Gives a request's buffer to the camera, for which the library takes five blocks from the heap.
  bool queue(libcamera::Request& request) {
    if (request.status() != libcamera::Request::RequestPending)
      request.reuse(libcamera::Request::ReuseBuffers);
    return camera_->queueRequest(&request) == 0;
  }

  /// The library's thread: a picture is there, and what was released since the last one goes back. The camera
  /// keeps a buffer always; where it has no other, this picture is passed over, as its sequence number tells.
  void on_completed(libcamera::Request* request) {
    if (request->status() == libcamera::Request::RequestCancelled) return;
    while (const auto index = arrivals_.released()) queue_again(*requests_[*index]);
    --with_camera_;
    if (with_camera_ == 0) return queue_again(*request);
    arrivals_.arrive(index_of(*request));
  }
  void queue_again(libcamera::Request& request) {
    ++with_camera_;
    // A camera that takes no buffer any more is gone, unless it is being stopped.
    if (!queue(request) && streaming_.load(std::memory_order_acquire)) on_gone();
  }
  /// The library's thread.
  void on_gone() {
    gone_.store(true, std::memory_order_release);
    arrivals_.wake();
  }

  /// Holds the request's picture; false where it is damaged.
  bool take(libcamera::Request& request) {
    const libcamera::FrameBuffer& buffer = *request.buffers().begin()->second;
    const libcamera::FrameMetadata& metadata = buffer.metadata();
    const std::uint32_t step = last_sequence_ ? metadata.sequence - *last_sequence_ : 1;
    constexpr std::uint32_t kSaneGap = 1000;  // a counter that starts anew is no gap
    last_sequence_ = metadata.sequence;
    held_.missed += step >= 1 && step <= kSaneGap ? step - 1 : 0;
    const MappedBuffer& mapped = buffers_[index_of(request)];
    if (metadata.status != libcamera::FrameMetadata::FrameSuccess) return false;
    held_.picture = {info_.format, info_.width, info_.height, {}};
    const std::size_t planes = std::min(mapped.planes().size(), held_.picture.planes.size());
    for (std::size_t p = 0; p < planes; ++p) {
      const std::size_t used =
          std::min<std::size_t>(metadata.planes()[p].bytesused, mapped.planes()[p].bytes);
      held_.picture.planes[p] = {mapped.planes()[p].start, used, configuration_->at(0).stride};
    }
    held_.stamp_ns = static_cast<Nanoseconds>(metadata.timestamp);
    mapped.begin_read();
    held_request_ = &request;
    return true;
  }

  CameraRequest request_;
  std::shared_ptr<libcamera::Camera> camera_;
  std::unique_ptr<libcamera::CameraConfiguration> configuration_;
  std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
  std::vector<std::unique_ptr<libcamera::Request>> requests_;
  std::vector<MappedBuffer> buffers_;  // one for each request
  Arrivals arrivals_;                  // of requests that the camera has served
  std::size_t with_camera_ = 0;        // requests; the library's thread counts while it streams
  std::atomic<bool> gone_{false}, streaming_{false};
  StreamInfo info_;
  HeldPicture held_;
  libcamera::Request* held_request_ = nullptr;
  std::optional<std::uint32_t> last_sequence_;
};

class LibcameraModule : public CameraModule {
 public:
  StreamPair make(const CameraRequest& request) override {
    return {std::make_unique<LibcameraStream>(request), nullptr};
  }
  /// The library knows a sensor's size at best, never the lens before it.
  std::optional<DeviceLens> lens(const CameraRequest&) override { return {}; }
  std::vector<FoundCamera> list() override {
    std::vector<FoundCamera> found;
    if (manager() == nullptr) return found;
    for (const auto& camera : manager()->cameras()) {
      const auto model = camera->properties().get(libcamera::properties::Model);
      found.push_back({camera->id(), model ? std::string(*model) : "camera"});
    }
    return found;
  }
};

}  // namespace

}  // namespace stillmap

extern "C" __attribute__((visibility("default"))) stillmap::CameraModule* stillmap_camera_module() {
  static stillmap::LibcameraModule module;
  return &module;
}
