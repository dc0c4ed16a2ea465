// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/config.h"
#include "core/event.h"
#include "stream/stream_types.h"

namespace stillmap {

/// An event or a drop as people read it. Its code, by which programs know it, stands before the words.
struct LogWords {
  LogLevel level = LogLevel::Info;
  std::string text;
};

/// "CODE at frame N: words" with units and, where a key decides, its name and value. `refusal` is why the
/// camera could not be opened, for SourceRefused. It uses the heap.
LogWords event_words(const Event& event, const Config& config, const char* refusal);

/// "REASON (words)".
std::string drop_words(DropReason reason, const CameraModel& camera);

}  // namespace stillmap
