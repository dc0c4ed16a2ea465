// SPDX-License-Identifier: Apache-2.0
#include "runtime/driver_module.h"

#include <dlfcn.h>

#include <algorithm>
#include <cctype>

namespace stillmap {

Result<CameraModule*> open_driver_module(const std::string& name) {
  const std::string library = "libstillmap_driver_" + name + ".so";
  std::string option = "STILLMAP_WITH_" + name;
  std::transform(option.begin(), option.end(), option.begin(),
                 [](unsigned char c) { return std::toupper(c); });
  void* opened = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (opened == nullptr) {
    return Error{ExitCode::WrongConfig, "the driver for " + name + " cannot be opened: " + dlerror() +
                                            "; install the package stillmap-" + name + ", or build with " +
                                            option + "=ON"};
  }
  // A pointer to data and one to a function are alike on every system that has dlopen.
  const auto entry = reinterpret_cast<CameraModuleEntry>(dlsym(opened, kCameraModuleEntry));
  if (entry == nullptr) return Error{ExitCode::WrongConfig, library + ": is no driver of stillmap"};
  return entry();
}

}  // namespace stillmap
