// A correction of the place held as a hand may feel it: no step. The god object goes to its new place bit by
// bit, and where it is set free to the HIP.
#pragma once

#include <algorithm>

#include "toolkit/core/vec.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Belongs to one contact. Over so many frames: a pull of 1 mm that is corrected at 0.5 N/mm changes the
/// force by 0.025 N a frame at 1 kHz, a twentieth of what counts as a kick, and is over in the time that a
/// hand takes to notice.
class SpreadStep {
 public:
  static constexpr int kFrames = 20;

  void end() noexcept { left_ = 0; }
  [[nodiscard]] bool active() const noexcept { return left_ > 0; }
  /// The pull of this frame at h, zero where nothing holds; `before`: what it would be without a correction
  /// of this frame, or null. False where nothing is felt. Only where there is a correction, or active().
  [[nodiscard]] bool apply(const Vec3& h, const Vec3* before, bool held, Vec3& pull) noexcept {
    if (before != nullptr) {
      if (!active()) {
        shown_ = h + *before;
        length_ = before->norm();
      }
      left_ = kFrames;
      grows_ = length_ < pull.norm();
    }
    // It only descends: no farther from the HIP than it was, so that no energy is made, and a HIP that jumps
    // takes no spring along. Where its place is farther the hand has to go there first.
    // A HIP that was found behind a surface is held by more and more.
    const double wanted = pull.norm();
    const double before_now = std::min((shown_ - h).norm(), std::max(length_, wanted));
    const double most = grows_ ? std::max(before_now, wanted) : before_now;
    const Vec3 place = h + pull;
    shown_ = place + (shown_ - place) * (static_cast<double>(left_ - 1) / left_);
    const double size = (shown_ - h).norm();
    if (size > most) shown_ = h + (shown_ - h) * (most / size);
    if (left_ > 1 || !(wanted > most)) --left_;
    length_ = (shown_ - h).norm();
    if (active()) pull = shown_ - h;
    return held || active();
  }
  /// The same of a model's answer, which `read()` fills where nothing holds but the correction.
  template <class Read>
  [[nodiscard, gnu::noinline]] bool answer(const Vec3& h, const Vec3* before, bool held,
                                           SurfaceContact& contact, Read&& read) noexcept {
    Vec3 pull = held ? contact.pull : Vec3(Vec3::Zero());
    if (!apply(h, before, held, pull)) return false;
    if (!held) read();
    contact.pull = pull;
    return true;
  }

 private:
  Vec3 shown_ = Vec3::Zero();  ///< the god object as it was answered last, local
  double length_ = 0.0;        ///< of the pull that was answered last
  int left_ = 0;
  bool grows_ = false;  ///< it holds the HIP by more than before
};

}  // namespace palpate::render
