// A correction of the place held as a hand may feel it: no step. The god object goes to its new place bit by
// bit, and where it is set free to the HIP.
#pragma once

#include "toolkit/core/vec.h"

namespace palpate::render {

/// Belongs to one contact. Over so many frames: a pull of 1 mm that is corrected at 0.5 N/mm changes the
/// force by 0.025 N a frame at 1 kHz, a twentieth of what counts as a kick, and is over in the time that a
/// hand takes to notice. The god object only goes towards its new place.
class SpreadStep {
 public:
  static constexpr int kFrames = 20;

  void end() noexcept { left_ = 0; }
  [[nodiscard]] bool active() const noexcept { return left_ > 0; }
  /// The pull of this frame at h, zero where nothing holds; `before`: what it would be without a correction
  /// of this frame, or null. False where nothing is felt. Only where there is a correction, or active().
  [[nodiscard]] bool apply(const Vec3& h, const Vec3* before, bool held, Vec3& pull) noexcept {
    if (before != nullptr) {
      if (!active()) shown_ = h + *before;
      left_ = kFrames;
      fades_ = !held;
    }
    // A HIP that came out by itself is out.
    if (!held && !fades_) {
      left_ = 0;
      return false;
    }
    const Vec3 place = h + pull;
    // What is held goes on with its surface; a HIP that was set free takes nothing along.
    if (before == nullptr && held && !fades_) shown_ += place - place_;
    if (held) fades_ = false;
    place_ = place;
    shown_ = place + (shown_ - place) * (static_cast<double>(left_ - 1) / left_);
    --left_;
    if (active()) pull = shown_ - h;
    return held || active();
  }

 private:
  Vec3 shown_ = Vec3::Zero();  ///< the god object as it was answered last, local
  Vec3 place_ = Vec3::Zero();  ///< where it is held
  int left_ = 0;
  bool fades_ = false;  ///< the correction set the HIP free
};

}  // namespace palpate::render
