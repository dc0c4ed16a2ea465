// SPDX-License-Identifier: Apache-2.0
#include "runtime/log_sink.h"

#include <spdlog/details/null_mutex.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <memory>

#include "core/stderr_text.h"

namespace stillmap {

namespace {

class StderrSink final : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    write_stderr({line.data(), line.size()});
  }
  void flush_() override {}
};

}  // namespace

void log_to_stderr() {
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("stillmap", std::make_shared<StderrSink>()));
}

}  // namespace stillmap
