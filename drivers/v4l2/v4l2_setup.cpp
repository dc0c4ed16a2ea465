// SPDX-License-Identifier: Apache-2.0
#include <errno.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstring>

#include "drivers/v4l2/v4l2_node.h"

namespace stillmap {

namespace {

Error refused(const V4l2Request& request, const std::string& what, ExitCode code = ExitCode::RunFailed) {
  return {code, request.device + ": " + what};
}

std::string size_text(std::uint32_t width, std::uint32_t height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

/// Every format that the node has, for an error's words.
std::string offered_formats(int file, std::uint32_t type) {
  std::string list;
  v4l2_fmtdesc description{};
  description.type = type;
  for (; v4l2_ioctl(file, VIDIOC_ENUM_FMT, &description); ++description.index)
    list.append(list.empty() ? "" : " ").append(fourcc_text(description.pixelformat));
  return list.empty() ? "none" : list;
}

bool offers(int file, std::uint32_t type, std::uint32_t fourcc) {
  v4l2_fmtdesc description{};
  description.type = type;
  for (; v4l2_ioctl(file, VIDIOC_ENUM_FMT, &description); ++description.index) {
    if (description.pixelformat == fourcc) return true;
  }
  return false;
}

/// "White Balance, Auto" to "white_balance_auto", as v4l2-ctl writes it.
std::string plain_name(const char* name) {
  std::string plain;
  for (; *name != '\0'; ++name) {
    if (std::isalnum(static_cast<unsigned char>(*name)) != 0) {
      plain += static_cast<char>(std::tolower(static_cast<unsigned char>(*name)));
    } else if (!plain.empty() && plain.back() != '_') {
      plain += '_';
    }
  }
  while (!plain.empty() && plain.back() == '_') plain.pop_back();
  return plain;
}

/// The node's capture type, or 0.
std::uint32_t capture_type(const v4l2_capability& capability) {
  const std::uint32_t can = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0 ? capability.device_caps
                                                                                  : capability.capabilities;
  if ((can & V4L2_CAP_STREAMING) == 0) return 0;
  if ((can & V4L2_CAP_VIDEO_CAPTURE) != 0) return V4L2_BUF_TYPE_VIDEO_CAPTURE;
  return (can & V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0 ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : 0;
}

}  // namespace

Status V4l2Stream::Node::open(const V4l2Request& request) {
  file_ = ::open(request.device.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (file_ < 0) {
    if (errno == EACCES)
      return refused(request, "no permission; add the user to the group \"video\" and log in again");
    if (errno == EBUSY) return refused(request, "another program uses it; `fuser " + request.device + "`");
    return refused(request, "no such camera (" + std::string(std::strerror(errno)) +
                                "); `stillmap devices` lists what is there");
  }
  if (Status s = check_capabilities(request); !s.ok()) return s;
  Status format = request.depth ? set_format(request, kV4l2Depths) : set_format(request, kV4l2Colours);
  if (!format.ok()) return format;
  set_rate(request.fps);
  if (Status s = set_controls(request); !s.ok()) return s;
  return map_buffers(request);
}

Status V4l2Stream::Node::check_capabilities(const V4l2Request& request) {
  v4l2_capability capability{};
  if (!v4l2_ioctl(file_, VIDIOC_QUERYCAP, &capability)) return refused(request, "is no video node");
  type_ = capture_type(capability);
  if (type_ == 0) return refused(request, "captures no pictures; `stillmap devices` lists what does");
  return {};
}

bool V4l2Stream::Node::try_format(const V4l2Request& request, const V4l2Format& wanted,
                                  v4l2_format& offered) {
  const bool multi = V4L2_TYPE_IS_MULTIPLANAR(type_);
  offered = {};
  offered.type = type_;
  const auto width = static_cast<std::uint32_t>(request.width);
  const auto height = static_cast<std::uint32_t>(request.height);
  if (multi) {
    offered.fmt.pix_mp.width = width, offered.fmt.pix_mp.height = height;
    offered.fmt.pix_mp.pixelformat = wanted.fourcc;
    offered.fmt.pix_mp.field = V4L2_FIELD_NONE;
  } else {
    offered.fmt.pix.width = width, offered.fmt.pix.height = height;
    offered.fmt.pix.pixelformat = wanted.fourcc;
    offered.fmt.pix.field = V4L2_FIELD_NONE;
  }
  if (!v4l2_ioctl(file_, VIDIOC_S_FMT, &offered)) return false;
  return multi ? offered.fmt.pix_mp.pixelformat == wanted.fourcc && offered.fmt.pix_mp.width == width &&
                     offered.fmt.pix_mp.height == height
               : offered.fmt.pix.pixelformat == wanted.fourcc && offered.fmt.pix.width == width &&
                     offered.fmt.pix.height == height;
}

Status V4l2Stream::Node::set_format(const V4l2Request& request, std::span<const V4l2Format> known) {
  std::string nearest;
  bool known_name = request.format.empty();
  for (const V4l2Format& wanted : known) {
    if (!request.format.empty() && !is_named(wanted.fourcc, request.format)) continue;
    known_name = true;
    v4l2_format offered{};
    if (!offers(file_, type_, wanted.fourcc)) continue;
    errno = 0;
    if (!try_format(request, wanted, offered)) {
      if (errno == EBUSY) return refused(request, "another program uses it; `fuser " + request.device + "`");
      nearest.append(nearest.empty() ? "" : ", ").append(fourcc_text(wanted.fourcc)).append(" ");
      nearest += V4L2_TYPE_IS_MULTIPLANAR(type_)
                     ? size_text(offered.fmt.pix_mp.width, offered.fmt.pix_mp.height)
                     : size_text(offered.fmt.pix.width, offered.fmt.pix.height);
      continue;
    }
    info_ = {.name = request.device,
             .format = wanted.format,
             .width = request.width,
             .height = request.height,
             .fps = request.fps,
             .monotonic_stamps = true};
    planes_ = wanted.own_chroma_plane ? 2 : 1;
    for (std::size_t p = 0; p < planes_; ++p) {
      strides_[p] = V4L2_TYPE_IS_MULTIPLANAR(type_) ? offered.fmt.pix_mp.plane_fmt[p].bytesperline
                                                    : offered.fmt.pix.bytesperline;
      strides_[p] = std::max(strides_[p], row_bytes(wanted.format, request.width));
    }
    return {};
  }
  const std::string kind = request.depth ? "depth" : "colour";
  if (!known_name) {
    return refused(request, "format \"" + request.format + "\" is none that can be read as " + kind,
                   ExitCode::WrongConfig);
  }
  return refused(
      request,
      "no " + kind + " of " +
          size_text(static_cast<std::uint32_t>(request.width), static_cast<std::uint32_t>(request.height)) +
          " px" + (request.format.empty() ? "" : " as " + request.format) + "; it has the formats " +
          offered_formats(file_, type_) + (nearest.empty() ? "" : "; nearest: " + nearest) +
          "; change camera.width and camera.height, or the camera",
      ExitCode::WrongConfig);
}

/// Not every driver can be asked; then the rate is what it is, and the stamps tell.
void V4l2Stream::Node::set_rate(double fps) {
  v4l2_streamparm parameters{};
  parameters.type = type_;
  parameters.parm.capture.timeperframe = {1000, static_cast<std::uint32_t>(std::lround(fps * 1000))};
  if (!v4l2_ioctl(file_, VIDIOC_S_PARM, &parameters)) return;
  const v4l2_fract& period = parameters.parm.capture.timeperframe;
  if (period.numerator > 0) info_.fps = static_cast<double>(period.denominator) / period.numerator;
}

Status V4l2Stream::Node::set_controls(const V4l2Request& request) {
  for (const std::string& setting : request.controls) {
    const std::size_t equals = setting.find('=');
    const std::string name = setting.substr(0, equals);
    std::int32_t value = 0;
    const char* digits = setting.data() + (equals == std::string::npos ? setting.size() : equals + 1);
    const auto [end, error] = std::from_chars(digits, setting.data() + setting.size(), value);
    if (equals == std::string::npos || error != std::errc{} || end != setting.data() + setting.size()) {
      return refused(request, "control \"" + setting + "\" is not NAME=NUMBER", ExitCode::WrongConfig);
    }
    v4l2_queryctrl found{};
    std::string names;
    found.id = V4L2_CTRL_FLAG_NEXT_CTRL;
    bool known = false;
    while (!known && v4l2_ioctl(file_, VIDIOC_QUERYCTRL, &found)) {
      const std::string have = plain_name(reinterpret_cast<const char*>(found.name));
      known = have == name;
      if (found.type != V4L2_CTRL_TYPE_CTRL_CLASS) names += (names.empty() ? "" : " ") + have;
      if (!known) found.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    }
    if (!known) {
      return refused(request, "has no control \"" + name + "\"; it has: " + names, ExitCode::WrongConfig);
    }
    v4l2_control control{found.id, value};
    // A driver may take another value than it was given, and say so.
    if (!v4l2_ioctl(file_, VIDIOC_S_CTRL, &control) || control.value != value) {
      return refused(request,
                     "control \"" + setting + "\" was refused; it goes from " +
                         std::to_string(found.minimum) + " to " + std::to_string(found.maximum),
                     ExitCode::WrongConfig);
    }
  }
  return {};
}

Status V4l2Stream::Node::map_buffers(const V4l2Request& request) {
  v4l2_requestbuffers wanted{};
  wanted.count = kBuffers;
  wanted.type = type_;
  wanted.memory = V4L2_MEMORY_MMAP;
  if (!v4l2_ioctl(file_, VIDIOC_REQBUFS, &wanted) || wanted.count < 2) {
    return refused(request, errno == EBUSY ? "another program uses it; `fuser " + request.device + "`"
                                           : std::string("the driver gives no buffers (") +
                                                 std::strerror(errno) + "); free some memory");
  }
  buffers_.resize(wanted.count);
  for (std::uint32_t i = 0; i < wanted.count; ++i) {
    std::array<v4l2_plane, kMaxPlanes> planes{};
    v4l2_buffer buffer = buffer_header(planes, i);
    if (!v4l2_ioctl(file_, VIDIOC_QUERYBUF, &buffer)) return refused(request, "a buffer cannot be asked for");
    for (std::size_t p = 0; p < planes_; ++p) {
      const bool multi = V4L2_TYPE_IS_MULTIPLANAR(type_);
      const std::size_t bytes = multi ? planes[p].length : buffer.length;
      const auto offset = static_cast<off_t>(multi ? planes[p].m.mem_offset : buffer.m.offset);
      void* start = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file_, offset);
      if (start == MAP_FAILED) return refused(request, "a buffer cannot be mapped; free some memory");
      buffers_[i][p] = {start, bytes};
    }
  }
  return {};
}

std::vector<V4l2Device> list_v4l2_devices() {
  std::vector<V4l2Device> devices;
  constexpr int kMaxNodes = 64;
  for (int i = 0; i < kMaxNodes; ++i) {
    const std::string path = "/dev/video" + std::to_string(i);
    const int file = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (file < 0) continue;
    v4l2_capability capability{};
    const bool asked = v4l2_ioctl(file, VIDIOC_QUERYCAP, &capability);
    if (const std::uint32_t type = asked ? capture_type(capability) : 0; type != 0) {
      V4l2Device device{path, reinterpret_cast<const char*>(capability.card),
                        reinterpret_cast<const char*>(capability.bus_info)};
      for (const V4l2Format& f : kV4l2Colours) {
        if (offers(file, type, f.fourcc))
          device.as_colour = std::max(device.as_colour, f.format == PixelFormat::Grey ? 1 : 2);
      }
      for (const V4l2Format& f : kV4l2Depths) {
        if (offers(file, type, f.fourcc))
          device.as_depth = std::max(device.as_depth, f.fourcc == V4L2_PIX_FMT_Z16 ? 2 : 1);
      }
      devices.push_back(device);
    }
    ::close(file);
  }
  return devices;
}

std::vector<V4l2Pair> pair_v4l2_devices(const std::vector<V4l2Device>& devices) {
  std::vector<V4l2Pair> pairs;
  for (const V4l2Device& depth : devices) {
    const auto worth = [&](const V4l2Device& d) { return d.as_colour + (d.bus == depth.bus ? 2 : 0); };
    const V4l2Device* partner = nullptr;
    for (const V4l2Device& d : devices) {
      if (d.as_colour == 0 || &d == &depth) continue;
      if (partner == nullptr || worth(d) > worth(*partner)) partner = &d;
    }
    if (depth.as_depth > 0 && partner != nullptr) pairs.push_back({partner, &depth});
  }
  std::ranges::stable_sort(pairs, std::ranges::greater{},
                           [](const V4l2Pair& p) { return p.depth->as_depth; });
  return pairs;
}

}  // namespace stillmap
