// Scores frame by frame as text: a CSV file beside the trace, with what scoring again needs of the true
// surface.
#pragma once

#include <cstdint>
#include <string>

#include "toolkit/core/input_file.h"
#include "toolkit/core/result.h"
#include "toolkit/metrics/accuracy.h"
#include "toolkit/trace/trace.h"

namespace palpate::metrics {

/// A row a frame: `t_s,missed,false`; then, where forces are compared,
/// `force_error_n,excess_jump_n,god_object_error_mm`; then, where a true surface was asked,
/// `god_object_distance_mm`, with friction `friction_ratio`, and with local resolutions `pop_throughs`. The
/// fewest digits that read back to the same bits. Lengths that differ are an Error.
[[nodiscard]] Status write_scores_csv(const trace::ProbePath& path, const AccuracyFrames& frames,
                                      const std::string& file);

/// Reads what write_scores_csv wrote of this path: rows and times must agree.
[[nodiscard]] Result<AccuracyFrames> read_scores_csv(const trace::ProbePath& path, const std::string& file,
                                                     std::uint64_t max_bytes = kMemoryLimitBytes);

}  // namespace palpate::metrics
