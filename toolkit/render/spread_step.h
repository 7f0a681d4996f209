// A correction of the place held as a hand may feel it: no step. What the pull changed by is taken back frame
// by frame.
#pragma once

#include "toolkit/core/vec.h"

namespace palpate::render {

/// Belongs to one contact. A pull of 1 mm at 0.5 N/mm, taken back in so many frames, changes the force by
/// 0.025 N a frame at 1 kHz: a twentieth of what counts as a kick, over in the time that a hand takes to
/// notice.
class SpreadStep {
 public:
  static constexpr int kFrames = 20;

  void end() noexcept { left_ = 0; }
  [[nodiscard]] bool active() const noexcept { return left_ > 0; }
  /// The pull of this frame, zero where nothing holds; `before`: what it would be without a correction of this
  /// frame, or null. False where nothing is felt. Only where there is a correction, or active().
  [[nodiscard]] bool apply(const Vec3* before, bool held, Vec3& pull) noexcept {
    if (before != nullptr) begin(*before, pull);
    --left_;
    pull += rest();
    return held || active();
  }

 private:
  void begin(const Vec3& before, const Vec3& after) noexcept {
    each_ = (before + rest() - after) / kFrames;
    left_ = kFrames;
  }
  [[nodiscard]] Vec3 rest() const noexcept { return each_ * static_cast<double>(left_); }

  Vec3 each_ = Vec3::Zero();
  int left_ = 0;
};

}  // namespace palpate::render
