// A simulated hand that feels what it touches, and the path of its HIP; see paths.h.
#pragma once

#include <memory>

#include "toolkit/trace/paths.h"

namespace palpate::trace {

/// Options of `hand`, validated.
struct HandOptions {
  std::size_t frames = 0;
  double rate_hz = 0.0;
  double force_n = 0.0;  ///< the hardest press
  double slowest_mm_s = 0.0, fastest_mm_s = 0.0;
  double bandwidth_hz = 0.0;  ///< of the hand against the stiffness that is felt
  std::uint64_t seed = 0;
};
/// Of a complete set of options. Errors: the slowest stroke is faster than the fastest.
[[nodiscard]] Result<HandOptions> read_hand_options(const Options& options);
/// Of "hand" or "hand:..", what is not given by default. Errors: any other text, options that are not right.
[[nodiscard]] Result<HandOptions> parse_hand(const std::string& text);

/// What a hand feels at its HIP.
struct Felt {
  Vec3 hip_mm = Vec3::Zero();
  Vec3 force_n = Vec3::Zero();  ///< of the surface; zero: no contact
  Vec3 handle_n =
      Vec3::Zero();  ///< what the handle pushes the hand with; without a device the surface's force
};

/// The intention of a hand. It presses along what it feels with a slowly changing force, drags along a
/// wandering heading, lifts every few seconds and sometimes taps. Where nothing is felt it goes by the points
/// that it sees: above them down, at the border of an open scan back to where it was. It gives way as a
/// damper does, v = (its force + the handle's) / b, b chosen so that its corner with
/// target.stiffness_n_per_mm lies at bandwidth_hz: a person's arm does not follow more than some 10 Hz.
/// Deterministic.
class Hand {
 public:
  /// Keeps references to the target's cloud and faces. O(points log points).
  [[nodiscard]] static Result<Hand> create(const PathTarget& target, const HandOptions& options);
  Hand(Hand&&) noexcept;
  Hand& operator=(Hand&&) noexcept;
  ~Hand();

  /// Relative to the cloud's origin, model frame: where it begins, free.
  [[nodiscard]] const Vec3& begin_mm() const noexcept;
  /// Where it means to go now, mm/s. Positions as in begin_mm(), vectors in the model frame. `t_s` grows by
  /// `dt_s` from step to step; at most some milliseconds. No allocation.
  [[nodiscard]] Vec3 step(const Felt& felt, double t_s, double dt_s) noexcept;

 private:
  struct State;
  explicit Hand(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// HIP positions in the model frame of a hand whose HIP is where it means to be. So the depth is never much
/// more than force_n over the stiffness, and what is right is beyond argument in every frame. `target.felt`
/// must be set. O(frames).
[[nodiscard]] Result<std::vector<Vec3>> by_hand(const PathTarget& target, const HandOptions& options);

}  // namespace palpate::trace
