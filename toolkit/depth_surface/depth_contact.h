// The contact with surfaces that come and go: a god object on the newest one.
//
// Between images a surface goes on at the speed it came with: contact is a matter of the frame that drifts
// with it, in which the HIP moves the other way. The felt god object moves as the HIP moves. Further motion
// of the surface's god object, as when a new surface takes over, is carried: a vector from it to where it was
// felt, which shrinks to nothing while one image passes. A surface that vanished leaves its tangent plane,
// which lets go in kReleaseSeconds.
#pragma once

#include <array>
#include <cstdint>

#include <palpate/renderer.h>
#include <palpate/vec.h>
#include "toolkit/depth_surface/depth_sheets.h"

namespace palpate::depth_surface {

/// Moves of the god object in a frame, each onto the tangent plane of the last. At a depth of a third of the
/// surface's radius each leaves a third of the error: 12 leave 2e-6.
inline constexpr int kMaxDepthMoves = 12;
/// Samples along the HIP's way in a frame; a pixel's step each up to 60 m/s at 1 m and 500 pixels focal
/// length.
inline constexpr int kMaxDepthSamples = 32;
/// Short beside a hand's reaction (150 ms), long beside a step that is felt (a few ms).
inline constexpr double kReleaseSeconds = 0.05;
/// A swap changes the force no faster than this, and what it says of the surface's speed by half as much.
inline constexpr double kMaxForceRateNPerS = 500.0;
/// Camera periods without an image after which it counts as silent.
inline constexpr double kStalledPeriods = 3.0;

/// Local coordinates throughout. For one thread.
class DepthContact {
 public:
  DepthContact(double stiffness_n_per_mm, double period_s) noexcept
      : most_mm_per_s_(0.5 * kMaxForceRateNPerS / stiffness_n_per_mm), period_s_(period_s) {}

  void release(const Vec3& hip) noexcept;
  [[nodiscard]] bool touching() const noexcept { return state_ != State::kFree; }
  /// Moves the HIP. `swapped`: the surface is newer than in the last frame. True in contact, with the pull
  /// from the HIP to the felt god object.
  [[nodiscard]] bool step(const DepthSheets& sheets, bool swapped, const Vec3& hip, double dt_s, Vec3& pull,
                          render::FrameStatus& status, render::FrameCounters& counters) noexcept;

 private:
  enum class State : std::uint8_t { kFree, kHeld, kLeaving };
  enum class Descent : std::uint8_t { kArrived, kAtRim, kNone };
  /// Where the HIP is to a layer's surface on its line of sight.
  struct Side {
    double w = 0.0;  ///< of the surface; 0: none there
    bool front = false;
  };
  using Sides = std::array<Side, DepthSheets::kLayers>;

  [[nodiscard]] Vec3 velocity_at(const DepthSheets& sheets, const Vec3& place) const noexcept;
  [[nodiscard]] Vec3 drift() const noexcept;
  void swap(const DepthSheets& sheets, render::FrameStatus& status, render::FrameCounters& counters) noexcept;
  bool cross(const DepthSheets& sheets, const Vec3& q, double pixels, double slack) noexcept;
  [[nodiscard]] Descent descend(const DepthSheets& sheets, const Vec3& hip, double slack,
                                render::FrameStatus& status, render::FrameCounters& counters) noexcept;
  [[nodiscard]] static Sides sides_at(const DepthSheets& sheets, const Vec3& q) noexcept;
  void enter(const DepthSheets& sheets, const Vec3& hip, render::FrameCounters& counters) noexcept;
  [[nodiscard]] bool hold(const DepthSheets& sheets, const Vec3& hip, double dt_s,
                          render::FrameStatus& status, render::FrameCounters& counters) noexcept;
  void carry(const Vec3& moved, double followed, double dt_s) noexcept;
  [[nodiscard]] bool fade_out(const DepthSheets& sheets, const Vec3& hip, double dt_s) noexcept;
  void leave() noexcept;

  /// Of the surface's drift, of what is carried, and of what is let go along the surface: half the rate each.
  double most_mm_per_s_;
  double period_s_;
  State state_ = State::kFree;
  std::uint64_t image_ = 0;  ///< of the last surface
  bool started_ = false;
  double since_s_ = 0.0;          ///< since the surface was taken
  Vec3 velocity_ = Vec3::Zero();  ///< of the surface
  Vec3 drift_ = Vec3::Zero();     ///< of the frame that moves with it, of which are the places below
  Vec3 last_ = Vec3::Zero();      ///< HIP of the last frame
  Sides sides_{};                 ///< free: of last_
  Vec3 god_ = Vec3::Zero();       ///< on the surface; leaving: on the plane
  Vec3 outward_ = Vec3::Zero();
  Vec3 carried_ = Vec3::Zero();  ///< from god_ to the felt god object
  double carried_mm_per_s_ = 0.0;
  Vec3 pull_ = Vec3::Zero();  ///< of the last frame
  double share_ = 0.0;        ///< leaving: of the pull
};

}  // namespace palpate::depth_surface
