// The hash of a force trace, frame by frame, for traces that are never whole in memory.
#pragma once

#include <string>

#include "toolkit/core/hash.h"
#include "toolkit/render/renderer.h"

namespace palpate::trace {

/// FNV-1a-64 over contact, force and god object of every frame that is added; trace_hash() is one of these.
class FrameHash {
 public:
  void add(const render::Frame& frame) noexcept {
    hash_.byte(frame.contact ? 1 : 0);
    for (int axis = 0; axis < 3; ++axis) hash_.real(frame.force_n[axis]);
    for (int axis = 0; axis < 3; ++axis) hash_.real(frame.god_object_mm[axis]);
  }
  /// Sixteen hexadecimal digits.
  [[nodiscard]] std::string hex() const { return hash_.hex(); }

 private:
  Hash64 hash_;
};

}  // namespace palpate::trace
