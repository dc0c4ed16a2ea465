// SPDX-License-Identifier: Apache-2.0
#include "detect/network.h"

#include <dlfcn.h>

#include <span>

#include "detect/int8_network.h"
#include "detect/onnx_file.h"

namespace stillmap {

namespace {

Result<std::unique_ptr<Network>> open_on_module(std::string_view onnx, const Letterbox& letterbox,
                                                const InputFormat& format) {
  constexpr const char* kLibrary = "libstillmap_network_opencv.so";
  void* library = dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    return Error{ExitCode::UnreadableInput,
                 std::string("OpenCV's module cannot be opened: ") + dlerror() +
                     "; install the package stillmap-opencv, or quantize the network with "
                     "scripts/quantize_model.py"};
  }
  // A pointer to data and one to a function are alike on every system that has dlopen.
  const auto entry = reinterpret_cast<NetworkModuleEntry>(dlsym(library, kNetworkModuleEntry));
  if (entry == nullptr)
    return Error{ExitCode::UnreadableInput, std::string(kLibrary) + " is no module of stillmap"};
  Result<std::unique_ptr<Network>> opened = Error{ExitCode::UnreadableInput, "nothing was opened"};
  entry(onnx, letterbox, format, opened);
  return opened;
}

}  // namespace

Result<std::unique_ptr<Network>> open_network(std::string_view onnx, const Letterbox& letterbox,
                                              const InputFormat& format) {
  std::string not_ours = "it is no ONNX file";
  if (const std::optional<OnnxFile> file = read_onnx(std::as_bytes(std::span(onnx)))) {
    Result<std::unique_ptr<Network>> ours = Int8Network::open(*file, letterbox, format);
    if (ours.ok()) return ours;
    not_ours = ours.error().message;
  }
  Result<std::unique_ptr<Network>> theirs = open_on_module(onnx, letterbox, format);
  if (!theirs.ok() && theirs.error().exit_code == ExitCode::UnreadableInput)
    return Error{ExitCode::UnreadableInput, not_ours + "; " + theirs.error().message};
  return theirs;
}

}  // namespace stillmap
