#include <palpate/reference.h>

namespace palpate::metrics {

Status check_starts_free(const trace::ProbePath& path, const TruthSurface& truth) {
  constexpr std::int64_t kFirstPathLine = 2;  // line 1 of a path file is its header
  if (path.hip_mm.empty()) return Error{"the path has no samples", "give a path with samples", path.name, 0};
  if (truth.signed_distance_mm(path.hip_mm[0]) < 0.0)
    return Error{"the path starts inside the true surface", "start the path in free space", path.name,
                 kFirstPathLine};
  return Done{};
}

}  // namespace palpate::metrics
