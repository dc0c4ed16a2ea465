// SPDX-License-Identifier: Apache-2.0
#include "runtime/driver_module.h"

#include <dlfcn.h>

namespace stillmap {

Result<CameraModule*> open_driver_module(const std::string& name) {
  const std::string library = "libstillmap_driver_" + name + ".so";
  void* opened = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (opened == nullptr) {
    return Error{ExitCode::WrongConfig, "the driver for " + name + " cannot be opened: " + dlerror() +
                                            "; install the package that it is in, or build with "
                                            "STILLMAP_WITH_OPENNI2=ON"};
  }
  // A pointer to data and one to a function are alike on every system that has dlopen.
  const auto entry = reinterpret_cast<CameraModuleEntry>(dlsym(opened, kCameraModuleEntry));
  if (entry == nullptr) return Error{ExitCode::WrongConfig, library + ": is no driver of stillmap"};
  return entry();
}

}  // namespace stillmap
