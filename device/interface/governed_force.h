// The only kind of force a device accepts. Only ForceGovernor can make one, so that no path leads from a
// renderer to a device around the governor: the compiler refuses it.
#pragma once

#include "toolkit/core/vec.h"

namespace palpate::device {

/// A force that passed the governor; device frame, N. Good for one sending: it moves but does not copy, and
/// what it was moved from is zero, so that an old force cannot be kept and sent again past the slew limit.
class GovernedForce {
 public:
  GovernedForce(const GovernedForce&) = delete;
  GovernedForce& operator=(const GovernedForce&) = delete;
  GovernedForce(GovernedForce&& other) noexcept : newtons_(other.newtons_) { other.newtons_.setZero(); }
  GovernedForce& operator=(GovernedForce&&) = delete;
  ~GovernedForce() = default;

  [[nodiscard]] const Vec3& newtons() const noexcept { return newtons_; }

 private:
  friend class ForceGovernor;
  explicit GovernedForce(const Vec3& newtons) noexcept : newtons_(newtons) {}

  Vec3 newtons_;
};

}  // namespace palpate::device
