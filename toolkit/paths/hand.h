// A simulated hand that reacts to force (palpate/paths.h).
#pragma once

#include <memory>

#include <palpate/paths.h>

namespace palpate::paths {

/// Options of `hand`, validated.
struct HandOptions {
  std::size_t frames = 0;
  double rate_hz = 0.0;
  double force_n = 0.0;  ///< the hardest press
  double slowest_mm_s = 0.0, fastest_mm_s = 0.0;
  double bandwidth_hz = 0.0;  ///< against the stiffness that is felt
  std::uint64_t seed = 0;
};
/// Reads a complete set of options. Error: the slowest stroke exceeds the fastest.
[[nodiscard]] Result<HandOptions> read_hand_options(const Options& options);
/// Parses "hand" or "hand:..", completed by defaults. Errors: other text, invalid options.
[[nodiscard]] Result<HandOptions> parse_hand(const std::string& text);

/// Input of a hand at its HIP: what it feels.
struct HandInput {
  Vec3 hip_mm = Vec3::Zero();
  Vec3 force_n = Vec3::Zero();  ///< of the surface; zero: no contact
  Vec3 handle_force_n =
      Vec3::Zero();  ///< force of the handle on the hand; without a device the surface's force
};

/// The intention of a hand: presses along the felt force with slow variation, drags along a wandering
/// heading, lifts every few seconds, sometimes taps. Without contact it goes by the visible points: above
/// them down, at an open scan's border back. It yields like a damper, v = (its force + the handle's) / b,
/// with b such that the corner frequency with target.stiffness_n_per_mm is bandwidth_hz (an arm follows up to
/// about 10 Hz). Deterministic.
class Hand {
 public:
  /// Keeps references to the target's cloud and faces. O(points log points).
  [[nodiscard]] static Result<Hand> create(const PathTarget& target, const HandOptions& options);
  Hand(Hand&&) noexcept;
  Hand& operator=(Hand&&) noexcept;
  ~Hand();

  /// Start position, free; relative to the cloud's origin, model frame.
  [[nodiscard]] const Vec3& start_mm() const noexcept;
  /// Intended velocity, mm/s. Positions as in start_mm(), vectors in the model frame. `t_s` grows by `dt_s`
  /// per step, at most some milliseconds. No allocation.
  [[nodiscard]] Vec3 step(const HandInput& felt, double t_s, double dt_s) noexcept;

 private:
  struct State;
  explicit Hand(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// HIP positions in the model frame of a hand that is always where it intends. The depth stays near force_n
/// over the stiffness, so the truth is unambiguous in every frame. `target.felt` must be set. O(frames).
[[nodiscard]] Result<std::vector<Vec3>> hand_path(const PathTarget& target, const HandOptions& options);

}  // namespace palpate::paths
