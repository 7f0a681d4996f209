// Per-frame scores as CSV, with the surface's values needed to score again.
#pragma once

#include <cstdint>
#include <string>

#include <palpate/accuracy.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/core/input_file.h"

namespace palpate::metrics {

/// A row per frame: `t_s,missed,false`; with forces compared
/// `force_error_n,excess_jump_n,god_object_error_mm`; with a true surface `god_object_distance_mm`, with
/// friction `friction_ratio`, with local resolutions `pop_throughs`. Fewest digits that read back to the same
/// bits. Differing lengths are an Error.
[[nodiscard]] Status write_scores_csv(const trace::ProbePath& path, const AccuracyFrames& frames,
                                      const std::string& file);

/// Reads write_scores_csv's output for this path; rows and times must agree.
[[nodiscard]] Result<AccuracyFrames> read_scores_csv(const trace::ProbePath& path, const std::string& file,
                                                     std::uint64_t max_bytes = kMemoryLimitBytes);

}  // namespace palpate::metrics
