// The hash of a force trace, computed frame by frame.
#pragma once

#include <string>

#include <palpate/renderer.h>
#include "toolkit/core/hash.h"

namespace palpate::trace {

/// FNV-1a-64 over contact, force and god object of every added frame; used by trace_hash().
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
