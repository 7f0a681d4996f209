#include <palpate/trace.h>
#include "toolkit/core/hash.h"
#include "toolkit/trace/frame_hash.h"

namespace palpate::trace {

std::string trace_hash(const ForceTrace& trace) {
  FrameHash hash;
  for (const render::Frame& frame : trace.frames) hash.add(frame);
  return hash.hex();
}

std::string path_hash(const ProbePath& path) {
  Hash64 hash;
  for (std::size_t i = 0; i < path.size(); ++i) {
    hash.real(path.t_s[i]);
    for (int axis = 0; axis < 3; ++axis) hash.real(path.hip_mm[i][axis]);
  }
  return hash.hex();
}

}  // namespace palpate::trace
