// Probe paths and force traces: the only input and the only output of an experiment.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/core/vec.h"
#include "toolkit/render/renderer.h"

namespace palpate::trace {

/// HIP positions over time, world frame. Time strictly increases.
struct ProbePath {
  std::string name;  ///< the file or the generator with its parameters
  std::vector<double> t_s;
  std::vector<Vec3> hip_mm;
  [[nodiscard]] std::size_t size() const noexcept { return t_s.size(); }
};

/// What a renderer answered, one entry per path sample.
struct ForceTrace {
  std::string label;
  std::vector<render::Frame> frames;
  std::vector<std::int64_t> frame_ns;  ///< per frame, clock cost included; empty where not timed
};

/// FNV-1a-64 over contact, force and god object of every frame; never times. Sixteen hexadecimal digits.
[[nodiscard]] std::string trace_hash(const ForceTrace& trace);

/// The same over times and positions of a path.
[[nodiscard]] std::string path_hash(const ProbePath& path);

/// The truth at one path sample.
struct TruthFrame {
  render::Frame frame;  ///< force, god object, contact of the true surface
  Vec3 normal =
      Vec3::UnitZ();  ///< outward at the true god object (or at the nearest surface point when free)
  double signed_distance_mm =
      0.0;  ///< of the HIP: minus the depth below the true god object in contact, else the distance
  double local_resolution_mm = 0.0;  ///< distance from the nearest cloud point there to its eighth neighbour
  /// Another reference, which knows no history, answers otherwise here: what is right depends on the way.
  bool history_decides = false;
};

/// The truth along a path.
struct ReferenceTrace {
  std::string name;       ///< "analytic", "original-mesh", "closest-point"
  std::string exactness;  ///< how exact it is, in words with numbers
  bool compared = false;  ///< with a second reference: history_decides is known
  std::vector<TruthFrame> frames;
};

}  // namespace palpate::trace
