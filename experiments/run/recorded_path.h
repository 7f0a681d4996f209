// A recording as a probe path: where the renderers' HIP went, call by call.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::experiments {

struct RecordedPath {
  trace::ProbePath path;
  std::vector<std::string> warnings;  ///< what is missing in the recording, whole sentences
};

/// The steps of the first renderer that was stepped in each tick, the small ones of a bring-up among them.
/// Where a renderer let go at a place known to be free, the path goes by that place, half way in time between
/// its neighbours: so it starts free, and does not cut through a surface between two segments. Steps whose
/// HIP is not finite, or whose time does not go on, are left out. At most `max_bytes` of memory.
[[nodiscard]] Result<RecordedPath> path_of_recording(const std::string& file, std::uint64_t max_bytes);

}  // namespace palpate::experiments
