// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Before a function whose loops work on whole rows of integers: built twice, for the stated baseline and for
/// AVX2, and chosen by the loader. For integers only: their results are the same, so that a run stays equal
/// byte for byte. Sanitizers start later than the loader chooses, so they get the baseline, and so does
/// Clang, which is for building with them.
#if defined(__x86_64__) && !defined(__clang__) && !defined(STILLMAP_SANITIZED)
#define STILLMAP_VECTOR_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define STILLMAP_VECTOR_CLONES
#endif
