// SPDX-License-Identifier: Apache-2.0
#include "runtime/doctor.h"

#include <linux/capability.h>
#include <spdlog/fmt/fmt.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <thread>

#include "runtime/capture.h"
#include "runtime/memory_lock.h"

namespace stillmap {

namespace {

namespace fs = std::filesystem;

/// The first word of a file of /sys; empty where there is none.
std::string word_of(const fs::path& path) {
  std::string word;
  std::ifstream(path) >> word;
  return word;
}

std::vector<fs::path> entries(const fs::path& folder) {
  std::error_code none;
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder, none)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  return paths;
}

/// Steps of a chain of dependent multiplications per second: what one core does whatever its vectors can.
double steps_per_second() {
  constexpr int kSteps = 20'000'000;
  std::uint64_t state = 1;
  const Nanoseconds begin = thread_cpu_now();  // others may be busy on this core
  for (int i = 0; i < kSteps; ++i) {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    asm volatile("" : "+r"(state));
  }
  return kSteps / to_seconds(thread_cpu_now() - begin);
}

Finding cores() {
  const unsigned count = std::thread::hardware_concurrency();
  return {count >= 2, fmt::format("{} cores", count),
          "tracking has a core, detection and map another: use a machine with two, or detector.model=none"};
}

Finding core_speed() {
  // A multiplication and an addition take 4 cycles in turn; 1.2 GHz is what a Raspberry Pi 4 has at its
  // slowest.
  constexpr double kSlowest = 300e6;
  const double speed = steps_per_second();
  return {speed >= kSlowest, fmt::format("core speed: {:.0f} million dependent steps a second", speed / 1e6),
          "the core is slow or throttled: check cooling and supply voltage, and the governor"};
}

void governors(const fs::path& root, std::vector<Finding>& findings) {
  const std::string governor = word_of(root / "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (governor.empty()) return;
  findings.push_back({governor != "powersave", "frequency governor: " + governor,
                      "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"});
}

Finding limit_of(int resource, unsigned capability, const std::string& name, rlim_t enough,
                 const std::string& mend) {
  rlimit limit{};
  getrlimit(static_cast<__rlimit_resource_t>(resource), &limit);
  const bool endless = limit.rlim_cur == RLIM_INFINITY, enough_for_all = endless || limit.rlim_cur >= enough;
  const std::string value = endless ? "unlimited" : std::to_string(limit.rlim_cur);
  if (enough_for_all || !has_capability(capability)) return {enough_for_all, name + ": " + value, mend};
  return {true, name + ": " + value + ", which a privilege of this user (root's) lifts", mend};
}

/// Cameras of a protocol of their own, which OpenNI2 reads with a plug-in.
struct PlugIn {
  const char *vendor, *product;  ///< of the USB device; a null product: each of the vendor's
  const char *file, *mend;
};
constexpr PlugIn kPlugIns[]{
    {"1d27", nullptr, "libPS1080.so.0", "apt-get install libopenni2-0"},
    {"2bc5", nullptr, "liborbbec.so.0",
     "put liborbbec.so of Orbbec's OpenNI2 SDK there under that name; see docs/cameras.md"},
    {"045e", "02ae", "libFreenectDriver.so.0",
     "build libfreenect with its OpenNI2 driver and put it there under that name; see docs/cameras.md"}};

const PlugIn* plug_in_of(const fs::path& device) {
  const std::string vendor = word_of(device / "idVendor"), product = word_of(device / "idProduct");
  const auto* found = std::ranges::find_if(kPlugIns, [&](const PlugIn& p) {
    return vendor == p.vendor && (p.product == nullptr || product == p.product);
  });
  return found == std::end(kPlugIns) ? nullptr : found;
}

Finding plug_in(const fs::path& root, const PlugIn& wanted) {
  const auto has = [&](const fs::path& libraries) {
    return fs::exists(libraries / "OpenNI2/Drivers" / wanted.file);
  };
  return {std::ranges::any_of(entries(root / "usr/lib"), has),
          std::string("OpenNI2's plug-in for it, OpenNI2/Drivers/") + wanted.file, wanted.mend};
}

void usb_cameras(const fs::path& root, std::vector<Finding>& findings) {
  for (const fs::path& device : entries(root / "sys/bus/usb/devices")) {
    constexpr const char* kVideo = "0e";
    bool video = false;
    for (const fs::path& part : entries(device)) video |= word_of(part / "bInterfaceClass") == kVideo;
    const std::string vendor = word_of(device / "idVendor");
    const PlugIn* own_protocol = plug_in_of(device);
    if (!video && own_protocol == nullptr) continue;
    std::string name;
    std::ifstream product(device / "product");
    std::getline(product, name);
    const std::string speed = word_of(device / "speed");
    constexpr double kUsb3_mbps = 5000;
    const bool wants_usb3 = vendor == "8086";  // Intel's; the others are made for USB 2
    findings.push_back({!wants_usb3 || std::atof(speed.c_str()) >= kUsb3_mbps,
                        "USB camera " + (name.empty() ? vendor : name) + " at " + speed + " Mbit/s",
                        "it is linked as USB 2: use a USB 3 port (blue) and a short USB 3 cable"});
    if (own_protocol != nullptr) findings.push_back(plug_in(root, *own_protocol));
  }
}

void video_nodes(const fs::path& root, std::vector<Finding>& findings) {
  int nodes = 0;
  for (const fs::path& node : entries(root / "dev")) {
    if (!node.filename().string().starts_with("video")) continue;
    ++nodes;
    findings.push_back({access(node.c_str(), R_OK | W_OK) == 0, node.string() + " can be opened",
                        "sudo usermod -aG video $USER, and log in again"});
  }
  if (nodes == 0) {
    findings.push_back({false, "no video node in /dev",
                        "plug the camera in; a container needs --device /dev/video0 for each node"});
  }
}

}  // namespace

std::vector<Finding> examine_machine(const std::string& root) {
  std::vector<Finding> findings{cores(), core_speed()};
  governors(root, findings);
  findings.push_back(
      limit_of(RLIMIT_RTPRIO, CAP_SYS_NICE, "limit of real-time priority", 20,
               "echo '@video - rtprio 40' | sudo tee /etc/security/limits.d/stillmap.conf, and "
               "log in again; without it frames are late under load"));
  findings.push_back(limit_of(RLIMIT_MEMLOCK, CAP_IPC_LOCK, "limit of locked memory (bytes)",
                              rlim_t{256} << 20,
                              "echo '@video - memlock unlimited' | sudo tee -a "
                              "/etc/security/limits.d/stillmap.conf, and log in again"));
  usb_cameras(root, findings);
  video_nodes(root, findings);
  return findings;
}

}  // namespace stillmap
