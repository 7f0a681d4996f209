// One reconstruction in a process of its own, within limits.
#pragma once

#include <cstddef>

#include "baselines/reconstruct/methods.h"
#include "baselines/reconstruct/reconstruction.h"
#include "toolkit/core/progress.h"

namespace palpate::baselines {

struct Limits {
  double time_s = 120.0;         ///< 0: none
  std::size_t memory_bytes = 0;  ///< of the process that reconstructs; 0: see memory_limit()
};

/// What `limits` allow: three quarters of the machine's memory where they say nothing.
[[nodiscard]] std::size_t memory_limit(const Limits& limits);

/// make_mesh() in a process of its own, the program palpate-reconstruct: beside the program that runs, where
/// it was built or installed, or where the variable PALPATE_RECONSTRUCT says. It is ended at the limits, when
/// `progress` says so, and with this process; nothing but its answer is left of it, no file at any time.
///
/// Errors: those of make_mesh(); "did not finish in N s" and "needed more than N GB" (gave_up is set); a
/// crash, with the last line that the library printed; the program is not there.
[[nodiscard]] Result<Reconstruction> run_limited(const Method& method, const cloud::Cloud& cloud,
                                                 const Options& options, const Limits& limits, int threads,
                                                 Progress& progress);

}  // namespace palpate::baselines
