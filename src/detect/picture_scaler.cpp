// SPDX-License-Identifier: Apache-2.0
#include "detect/picture_scaler.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/halve.h"

namespace stillmap {

namespace {

constexpr int kOne = 2048;  // the weight of both neighbours together

constexpr std::uint8_t Bgr::*kChannels[] = {&Bgr::b, &Bgr::g, &Bgr::r};

std::uint8_t level(float value) {
  return static_cast<std::uint8_t>(std::clamp(std::lrintf(value), 0L, 255L));
}

}  // namespace

PictureScaler::PictureScaler(int from_width, int from_height, int to_width, int to_height)
    : averages_(2 * to_width <= from_width) {
  STILLMAP_CHECK(from_width > 0 && from_height > 0 && to_width > 0 && to_height > 0);
  if (averages_ && from_width % to_width == 0 && from_height % to_height == 0) {
    whole_x_ = from_width / to_width;
    whole_y_ = from_height / to_height;
    return;
  }
  columns_ = averages_ ? averaging(from_width, to_width) : interpolating(from_width, to_width);
  rows_ = averages_ ? averaging(from_height, to_height) : interpolating(from_height, to_height);
  if (averages_) sums_.resize(3 * static_cast<std::size_t>(from_width));
}

std::vector<PictureScaler::Tap> PictureScaler::interpolating(int from, int to) {
  std::vector<Tap> taps(static_cast<std::size_t>(to));
  const double step = 1 / (static_cast<double>(to) / from);
  for (int i = 0; i < to; ++i) {
    const auto at = static_cast<float>((i + 0.5) * step - 0.5);
    const int floor = static_cast<int>(std::floor(at));
    Tap& tap = taps[static_cast<std::size_t>(i)];
    tap.first = std::clamp(floor, 0, from - 1);
    tap.second = std::clamp(floor + 1, 0, from - 1);
    tap.weight = static_cast<int>(std::lrintf((at - static_cast<float>(floor)) * kOne));
  }
  return taps;
}

std::vector<PictureScaler::Tap> PictureScaler::averaging(int from, int to) {
  std::vector<Tap> taps(static_cast<std::size_t>(to));
  const double step = static_cast<double>(from) / to;
  for (int i = 0; i < to; ++i) {
    const double begin = i * step, end = std::min((i + 1) * step, static_cast<double>(from));
    Tap& tap = taps[static_cast<std::size_t>(i)];
    tap.first = static_cast<int>(begin);
    tap.second = std::min(static_cast<int>(std::ceil(end)), from) - 1;
    tap.first_share = static_cast<float>(tap.first + 1 - begin);
    tap.last_share = static_cast<float>(end - tap.second);
  }
  return taps;
}

void PictureScaler::row(ImageView<const Bgr> from, int y, std::span<Bgr> out) {
  if (whole_x_ == 2 && whole_y_ == 2) {
    halve_row(from.row(2 * y), from.row(2 * y + 1), out);
  } else if (whole_x_ > 0) {
    average_whole(from, y, out);
  } else if (averages_) {
    average(from, rows_[static_cast<std::size_t>(y)], out);
  } else {
    interpolate(from, rows_[static_cast<std::size_t>(y)], out);
  }
}

void PictureScaler::interpolate(ImageView<const Bgr> from, const Tap& tap, std::span<Bgr> out) const {
  const Bgr *upper = from.row(tap.first), *lower = from.row(tap.second);
  for (std::size_t x = 0; x < out.size(); ++x) {
    const Tap& column = columns_[x];
    for (const auto channel : kChannels) {
      const auto along = [&](const Bgr* row) {
        return row[column.first].*channel * (kOne - column.weight) +
               row[column.second].*channel * column.weight;
      };
      const int above = ((along(upper) >> 4) * (kOne - tap.weight)) >> 16;
      const int below = ((along(lower) >> 4) * tap.weight) >> 16;
      out[x].*channel = static_cast<std::uint8_t>((above + below + 2) >> 2);
    }
  }
}

void PictureScaler::average_whole(ImageView<const Bgr> from, int y, std::span<Bgr> out) const {
  const float share = 1.f / static_cast<float>(whole_x_ * whole_y_);
  for (std::size_t x = 0; x < out.size(); ++x) {
    int b = 0, g = 0, r = 0;
    for (int dy = 0; dy < whole_y_; ++dy) {
      const Bgr* row = from.row(y * whole_y_ + dy) + x * static_cast<std::size_t>(whole_x_);
      for (int dx = 0; dx < whole_x_; ++dx) {
        b += row[dx].b;
        g += row[dx].g;
        r += row[dx].r;
      }
    }
    const auto mean = [share](int sum) { return level(static_cast<float>(sum) * share); };
    out[x] = {mean(b), mean(g), mean(r)};
  }
}

void PictureScaler::average(ImageView<const Bgr> from, const Tap& tap, std::span<Bgr> out) {
  const auto share = [](const Tap& t, int i) {
    return i == t.second ? t.last_share : i == t.first ? t.first_share : 1.f;
  };
  std::fill(sums_.begin(), sums_.end(), 0.f);
  float height = 0;
  for (int y = tap.first; y <= tap.second; ++y) {
    const Bgr* row = from.row(y);
    const float part = share(tap, y);
    height += part;
    for (std::size_t x = 0; x < sums_.size() / 3; ++x) {
      for (std::size_t c = 0; c < 3; ++c) sums_[3 * x + c] += part * static_cast<float>(row[x].*kChannels[c]);
    }
  }
  for (std::size_t x = 0; x < out.size(); ++x) {
    const Tap& column = columns_[x];
    float width = 0;
    float sum[3] = {};
    for (int i = column.first; i <= column.second; ++i) {
      const float part = share(column, i);
      width += part;
      for (std::size_t c = 0; c < 3; ++c) sum[c] += part * sums_[3 * static_cast<std::size_t>(i) + c];
    }
    for (std::size_t c = 0; c < 3; ++c) out[x].*kChannels[c] = level(sum[c] / (width * height));
  }
}

}  // namespace stillmap
