// A jump of the god object spread over several frames, so that a hand feels no step.
//
// Corrections of the held place jump, also those that release or catch the HIP, as do slips over edges and a
// coarser surface that takes over.
#pragma once

#include <algorithm>
#include <limits>
#include <utility>

#include <palpate/vec.h>
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Belongs to one contact. A pull that changes in a frame by a kFrames-th of itself and by kFaster times the
/// HIP's motion jumps; one of a free HIP is zero. It then changes by at most that share and the HIP's motion
/// a frame: of 1 mm at 0.5 N/mm by 0.025 N, a twentieth of a noticeable kick, and is there within a hand's
/// reaction time. Beside a rounded edge of radius r a pull changes kFaster times as fast as a HIP 2/3 r deep;
/// it jumps at r.
class CorrectionRamp {
 public:
  static constexpr int kFrames = 20;
  static constexpr double kFaster = 2.0;

  /// Forgets the contact.
  void end() noexcept {
    last_h_ = Vec3::Constant(kNowhere);
    active_ = false;
  }
  [[nodiscard]] bool active() const noexcept { return active_; }
  /// The surface came or went: what that changes is no jump, and may lengthen the pull.
  void surface_moved() noexcept {
    if (active_)
      grows_ = true;
    else
      last_h_ = Vec3::Constant(kNowhere);
  }
  /// Changes `contact`'s pull at h, which `read()` fills when nothing but the ramp holds the HIP. False if
  /// nothing is felt. Call it in every frame.
  template <class Read>
  [[nodiscard, gnu::always_inline]] bool answer(const Vec3& h, bool held, SurfaceContact& contact,
                                                Read&& read) noexcept {
    const Vec3 pull = held ? contact.pull : Vec3(Vec3::Zero()), motion = h - last_h_, change = pull - pull_;
    const double faster_sq = kFaster * kFaster * motion.squaredNorm();
    const Vec3 last = pull_;
    pull_ = pull;
    last_h_ = h;
    if (!(change.squaredNorm() > faster_sq) && !active_) [[likely]] {
      held_ = held;
      return held;
    }
    spread(motion, last, held);
    if (!active_) return held;
    if (!held) read();
    contact.pull = shown_;
    return true;
  }

 private:
  /// Makes `shown_` the pull to be felt while active. `last`: the contact's own pull of the last frame.
  [[gnu::noinline]] void spread(const Vec3& motion, const Vec3& last, bool held) noexcept {
    const Vec3 change = pull_ - last;
    const double wanted = pull_.norm();
    const bool was_held = std::exchange(held_, held);
    const bool jumped =
        change.norm() > kFaster * motion.norm() && change.norm() * kFrames > std::max(wanted, last.norm());
    if (!active_ && !jumped) return;
    Vec3 moved = motion;
    if (jumped && !active_) {
      shown_ = last - motion;
      rate_ = 0.0;
      moved = Vec3::Zero();
      grows_ = !was_held;
      active_ = true;
    }
    const double length = shown_.norm();
    if (jumped) rate_ = std::max(rate_, (grows_ ? wanted : length) / kFrames);
    // The ramp never moves the god object farther from the HIP, so it creates no energy, and a jumping HIP
    // drags no spring along. A farther target waits for the hand to go there. A HIP found behind a surface is
    // held with a growing pull.
    const double before_now = std::min((shown_ - moved).norm(), std::max(length, wanted));
    const double most = grows_ ? std::max(before_now, wanted) : before_now;
    const Vec3 way = pull_ - shown_;
    const double left = way.norm(), step = rate_ + moved.norm();
    shown_ = left > step ? Vec3(shown_ + way * (step / left)) : pull_;
    const double size = shown_.norm();
    if (size > most) shown_ *= most / size;
    active_ = left > step || wanted > most;
  }

  /// A place so far from any HIP that the first frame's motion allows every pull.
  static constexpr double kNowhere = std::numeric_limits<double>::max();

  bool held_ = false, active_ = false;
  bool grows_ = false;                                            ///< the hold is growing
  Vec3 pull_ = Vec3::Zero(), last_h_ = Vec3::Constant(kNowhere);  ///< the contact's own, of the last frame
  Vec3 shown_ = Vec3::Zero();                                     ///< the last pull felt
  double rate_ = 0.0;                                             ///< of the jump, mm a frame
};

}  // namespace palpate::render
