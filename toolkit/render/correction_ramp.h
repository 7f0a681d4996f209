// Spreads a correction of the god object over several frames, so that a hand feels no step. This includes
// corrections that release the HIP.
#pragma once

#include <algorithm>

#include <palpate/vec.h>
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Belongs to one contact. The number of frames: correcting a pull of 1 mm at 0.5 N/mm then changes the force
/// by 0.025 N a frame at 1 kHz, a twentieth of a noticeable kick, and ends within a hand's reaction time.
class CorrectionRamp {
 public:
  static constexpr int kFrames = 20;

  void end() noexcept { left_ = 0; }
  [[nodiscard]] bool active() const noexcept { return left_ > 0; }
  /// Computes this frame's pull at h, zero when nothing holds the HIP. `before`: the pull without this
  /// frame's correction, or null. False if nothing is felt. Call it only with a correction or while active().
  [[nodiscard]] bool apply(const Vec3& h, const Vec3* before, bool held, Vec3& pull) noexcept {
    if (before != nullptr) {
      if (!active()) {
        shown_ = h + *before;
        length_ = before->norm();
      }
      left_ = kFrames;
      grows_ = length_ < pull.norm();
    }
    // The ramp never moves the god object farther from the HIP, so it creates no energy, and a jumping HIP
    // drags no spring along. A farther target waits for the hand to go there. A HIP found behind a surface is
    // held with a growing pull.
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
  /// The same for a model's answer, which `read()` fills when only the correction holds the HIP.
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
  Vec3 shown_ = Vec3::Zero();  ///< god object of the last answer, local
  double length_ = 0.0;        ///< length of the last pull
  int left_ = 0;
  bool grows_ = false;  ///< the hold is growing
};

}  // namespace palpate::render
